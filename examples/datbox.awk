# Functions that read the input of a run, for the scripts of the examples:
#
#   awk -f ../datbox.awk -f silo.awk D0.12 D0.14 D0.16
#
# Reads: COMPUTE.RON, BODIES.DAT, BULK_BEHAV.DAT of a DATBOX
# Writes: nothing

# Number that follows the first match of a pattern in a line; 0 if there is none.
function number_after(pattern, words) { return match(words, pattern) ? substr(words, RSTART + RLENGTH) + 0 : 0 }

# First number that follows the name of a value in COMPUTE.RON, such as end_time, or mass of a field.
function option_number(datbox, name,    file, words, pattern, value) {
    file = datbox "/COMPUTE.RON"; pattern = name ": *(Some\\()?"; value = ""
    while (value == "" && (getline words < file) > 0) if (words ~ "(^|[ (])" name ":") value = number_after(pattern, words)
    close(file)
    if (value == "") { print file ": no " name > "/dev/stderr"; exit 1 }
    return value
}

# Uniform gravity, m/s^2.
function uniform_gravity(datbox,    file, words, k, sum) {
    file = datbox "/BULK_BEHAV.DAT"
    while ((getline words < file) > 0) for (k = 1; k <= 3; k++) sum += number_after("grv" k "=", words) ^ 2
    close(file)
    return sqrt(sum)
}

# Density of a material, kg/m^3.
function material_density(datbox, name,    file, words, value) {
    file = datbox "/BULK_BEHAV.DAT"
    while ((getline words < file) > 0) if (substr(words, 2, 5) == name) value = number_after("Umas=", words)
    close(file)
    return value
}

# Sets body_count; of the bodies that are spheres or polyhedra grain_count, grain_volume (m^3), mean_diameter (m, of spheres of equal
# volume), grain_density (kg/m^3) of the last and its mass grain_mass (kg); half_thickness of the last plate, m.
function read_bodies(datbox,    file, words, radius, material, grain_radius, grain_material, sum, k, half_length) {
    file = datbox "/BODIES.DAT"; body_count = grain_count = grain_volume = half_thickness = 0
    while ((getline words < file) > 0) {
        if (words ~ /^\$bdyty/) body_count++
        if (words ~ /avrd=/) { radius = number_after("avrd=", words); material = substr(words, 23, 5) }
        if (words ~ /^ (POLYR|SPHER)/) {
            grain_count++; sum += 2 * radius; grain_volume += ball_volume(radius); grain_radius = radius; grain_material = material
        }
        if (words ~ /^ PLANx/) for (k = 1; k <= 3; k++) {
            half_length = number_after("axe" k "=", words)
            if (k == 1 || half_length < half_thickness) half_thickness = half_length
        }
    }
    close(file)
    if (!grain_count) { print file ": no spheres or polyhedra" > "/dev/stderr"; exit 1 }
    mean_diameter = sum / grain_count
    grain_density = material_density(datbox, grain_material)
    grain_mass = grain_density * ball_volume(grain_radius)
}

function ball_volume(radius) { return 16 / 3 * atan2(1, 1) * radius ^ 3 }
