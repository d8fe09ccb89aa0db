# Writes the results of `make -C examples/accuracy-study` into docs/explanation/accuracy.md, between its marks, and the help texts of the
# presets into formats/src/accuracy/PRESET.txt; at the top folder of the project:
#   awk -f docs/accuracy/accuracy.awk docs/explanation/accuracy.md > docs/explanation/accuracy.md.part
# Numbers come from examples/accuracy-study/figures/SCENE/{accuracy,orders}.csv, of all realisations together, figures/SCENE-SEED/accuracy.csv, of
# each, and many/SCENE-SEED/{runs,times}.csv alone.
# A missing file or column is a fault.

function fault(text) { print FILENAME ":" FNR ": " text > "/dev/stderr"; failed = 1; exit 1 }

# Reads a CSV file: cells[file, row, column name], rows[file].
function load(file,    line, names, parts, k, n, row) {
    row = -1
    while ((getline line < file) > 0) {
        n = split(line, parts, ",")
        if (++row == 0) split(line, names, ",")
        else for (k = 1; k <= n; k++) cells[file, row, names[k]] = parts[k]
    }
    close(file)
    if (row < 1) fault(file ": no table; run `make -C examples/accuracy-study` first")
    rows[file] = row
}

function value(file, row, name) {
    if (!((file, row, name) in cells)) fault(file ": no column " name)
    return cells[file, row, name]
}

function row_of(file, run,    k) {
    for (k = 1; k <= rows[file]; k++) if (value(file, k, "run") == run) return k
    fault(file ": no run " run)
}

# Folder of the tables of a scene: of the first four those of all realisations together.
function tables(s) { return "examples/accuracy-study/figures/" scene[s] "/" }

# `single` counts the errors of the pressure within a factor of 3 of what their own runs state, of `singles`.
function realised(s,    file, r, k, x) {
    load(tables(s) "accuracy.csv")
    for (r = 1; r <= realisations; r++) {
        file = "examples/accuracy-study/figures/" scene[s] "-" (scene[s] == "heap" ? heap_seed[r] : seed[r]) "/accuracy.csv"; load(file)
        for (k = 1; k <= rows[file]; k++) {
            x = value(file, k, "single_over_estimated")
            if (x + 0 > 0) { singles[scene[s]]++; if (x <= 3 && x >= 1 / 3) single[scene[s]]++ }
        }
    }
}

function percent(x) { return x == "" ? "-" : sprintf("%.2g %%", 100 * x) }

function presets(    s, file, k, r, lmgc, worst, name) {
    print "| scene | run | seconds | LMGC90's over it | Z | ν | pressure | energy |\n|---|---|---|---|---|---|---|---|"
    for (s = 1; s <= scenes; s++) {
        file = tables(s) "accuracy.csv"
        lmgc = value(file, row_of(file, "lmgc90"), "seconds")
        for (k = 1; k <= 5; k++) {
            name = preset[k]; r = row_of(file, name)
            printf "| %s | %s | %.3f | %.1f | %s | %s | %s | %s |\n", k == 1 ? scene[s] : "", name == "lmgc90" ? "LMGC90's" : name, \
                value(file, r, "seconds"), lmgc / value(file, r, "seconds"), percent(value(file, r, "Z")), \
                percent(value(file, r, "nu")), percent(value(file, r, "pressure")), percent(value(file, r, "energy"))
        }
    }
}

# Least and largest error of a preset over the scenes without heap.
function range(name, column,    s, file, x, least, largest) {
    least = 1e9
    for (s = 1; s <= scenes; s++) {
        if (scene[s] == "heap") continue
        file = tables(s) "accuracy.csv"
        x = value(file, row_of(file, name), column)
        if (x > largest) largest = x
        if (x < least) least = x
    }
    return sprintf("%.2g to %s", 100 * least, percent(largest))
}

# Error of a preset in heap, where two runs of any settings differ by chance.
function by_chance(name, column) { return percent(value("examples/accuracy-study/figures/heap/accuracy.csv", \
    row_of("examples/accuracy-study/figures/heap/accuracy.csv", name), column)) }

# Help texts of the presets.
function statements(    k, s, file, name, x, low, high, cost, errors) {
    for (k = 1; k <= 4; k++) {
        name = preset[k]; low = 1e9; high = 0
        for (s = 1; s <= scenes; s++) {
            file = tables(s) "accuracy.csv"
            x = value(file, row_of(file, "standard"), "seconds") / value(file, row_of(file, name), "seconds")
            if (x < low) low = x
            if (x > high) high = x
        }
        if (name == "standard") cost = ""
        else if (high < 1) cost = sprintf("%d to %d times slower than standard; ", 1 / high + 0.5, 1 / low + 0.5)
        else cost = sprintf("%.2g to %.2g times as fast as standard; ", low, high)
        errors = sprintf("errors: solid fraction %s, pressure %s, neighbours per grain %s; in a heap, mostly by chance: %s, %s, %s", \
            range(name, "nu"), range(name, "pressure"), range(name, "Z"), \
            by_chance(name, "nu"), by_chance(name, "pressure"), by_chance(name, "Z"))
        printf "%s%s", cost, name == "reference" ? "the others are compared with it" : errors \
            > ("formats/src/accuracy/" name ".txt")
    }
}

# An error that does not depend on the option has no price.
function followed(order, r2, digit,    size) {
    size = order < 0 ? -order : order
    if (size < 0.1) return "no effect"
    return sprintf("%.2f (r² %.2f)", order, r2) (r2 >= 0.8 ? sprintf(", %.2g times", digit) : ", -")
}

# Requirements of the presets, and the results.
function verdict(    s, file, k, r, name, low, high, x, both, all, lmgc) {
    for (k = 1; k <= 2; k++) {
        name = preset[k]; low = 1e9; high = both = all = 0
        for (s = 1; s <= scenes; s++) {
            file = tables(s) "accuracy.csv"
            r = row_of(file, name); lmgc = value(file, row_of(file, "lmgc90"), "seconds")
            x = lmgc / value(file, r, "seconds")
            if (x < low) low = x
            if (x > high) high = x
            if (value(file, r, "nu") <= 0.01 && value(file, r, "pressure") <= 0.01) { both++; if (value(file, r, "Z") <= 0.01) all++ }
        }
        printf "- `%s`: %.1f to %.1f times as fast as LMGC90's parameters (target: %s); ν and pressure within 1 %% in %d of %d scenes, Z as well in %d.\n", \
            name, low, high, k == 1 ? "10" : "3", both, scenes, all
    }
    both = all = 0
    for (s = 1; s <= scenes; s++) {
        file = tables(s) "accuracy.csv"; r = row_of(file, "lmgc90")
        if (value(file, r, "nu") <= 0.01 && value(file, r, "pressure") <= 0.01) { both++; if (value(file, r, "Z") <= 0.01) all++ }
    }
    printf "- LMGC90's parameters: ν and pressure within 1 %% in %d of %d scenes, Z as well in %d.\n", both, scenes, all
}

# `of`: which error, the end of the names of the columns; of so many scenes, and groups of runs.
function knobs(of, shown, groups,    s, file, g, k, cell) {
    printf "| option |"; for (s = 1; s <= shown; s++) printf " %s |", scene[s]
    printf "\n|---|"; for (s = 1; s <= shown; s++) printf "---|"
    print ""
    for (s = 1; s <= shown; s++) load(tables(s) "orders.csv")
    for (g = 1; g <= groups; g++) {
        printf "| `%s` |", group[g]
        for (s = 1; s <= shown; s++) {
            file = tables(s) "orders.csv"; cell = "-"
            for (k = 1; k <= rows[file]; k++) if (value(file, k, "group") == group[g] && value(file, k, "order" of) != "")
                cell = followed(value(file, k, "order" of), value(file, k, "r2" of), value(file, k, "digit" of))
            printf " %s |", cell
        }
        print ""
    }
}

# Of many realisations: by how much the means of a setting are off those of `fine`, and by how much that could be chance.
function many(    s, scene_of, of, name, k, c, seed, file, x, y, d, n, sum, squares, base, sd, column, alone, means, setting, shown, last, time, lmgc) {
    split("collapse heap", scene_of, " ")
    of["collapse"] = "Z_interval nu pressure_interval"; of["heap"] = "Z_interval bed_nu bed_pressure_interval"
    last["collapse"] = 131; last["heap"] = 221 # the seeds of many.ron
    print "| scene | run | LMGC90's time over it | Z | ν | pressure | of one run |\n|---|---|---|---|---|---|---|"
    split("draft standard loose lmgc90", setting, " "); shown["loose"] = "`standard` with `tol` 1e-2"; shown["lmgc90"] = "LMGC90's"
    for (s = 1; s <= 2; s++) for (k = 1; k <= 4; k++) {
        name = setting[k]
        alone = means = ""; time = lmgc = 0
        for (c = 1; c <= split(of[scene_of[s]], column, " "); c++) {
            n = sum = squares = base = 0
            for (seed = 101; seed <= last[scene_of[s]]; seed++) {
                if (seed == 104) continue
                file = "examples/accuracy-study/many/" scene_of[s] "-" seed "/runs.csv"
                if (!(file in rows)) load(file)
                y = value(file, row_of(file, "fine"), column[c]); x = value(file, row_of(file, name), column[c])
                if (x == "" || y == "") fault(file ": no " column[c])
                d = x - y; n++; sum += d; squares += d * d; base += y
                if (c > 1) continue
                file = "examples/accuracy-study/many/" scene_of[s] "-" seed "/times.csv"
                if (!(file in rows)) load(file)
                time += value(file, row_of(file, name), "seconds"); lmgc += value(file, row_of(file, "lmgc90"), "seconds")
            }
            base /= n
            sd = sqrt((squares - sum * sum / n) / (n - 1))
            means = means sprintf(" %+.2f ± %.2f %% |", 100 * sum / n / base, 100 * sd / sqrt(n) / base)
            alone = alone sprintf("%s%s", c == 1 ? "" : ", ", percent(sqrt(squares / n) / base))
        }
        printf "| %s | %s | %.1f |%s %s |\n", k == 1 ? scene_of[s] : "", name in shown ? shown[name] : name, lmgc / time, means, alone
    }
}

# Cost and error of another method instead of the standard one; `folder`: of the tables of one realisation of a scene.
function instead(scene, folder, name, option,    file, run, base) {
    file = "examples/accuracy-study/figures/" folder "/accuracy.csv"
    if (!(file in rows)) load(file)
    run = row_of(file, name); base = row_of(file, "dt-1")
    printf "- `%s` in `%s`: %.2f times the seconds; error of the early positions %.1e in place of %.1e.\n", option, scene, \
        value(file, run, "seconds") / value(file, base, "seconds"), value(file, run, "positions_early"), value(file, base, "positions_early")
}

function honesty(    s, file, k, x, all, good, small, large, sum, sums, lone, honest) {
    print "| scene | of single runs within a factor of 3 | over " realisations " realisations within a factor of 3 | too small | too large |"
    print "|---|---|---|---|---|"
    for (s = 1; s <= scenes; s++) {
        file = tables(s) "accuracy.csv"; all = good = small = large = 0
        for (k = 1; k <= rows[file]; k++) {
            if (value(file, k, "pressure_single") == 0 || value(file, k, "estimated") == 0) continue
            x = value(file, k, "pressure_single") / value(file, k, "estimated")
            all++; if (x > 3) small++; else if (x < 1 / 3) large++; else good++
        }
        printf "| %s | %d of %d | %d of %d | %d | %d |\n", scene[s], single[scene[s]], singles[scene[s]], good, all, small, large
        sum += all; honest += good; sums += singles[scene[s]]; lone += single[scene[s]]
    }
    printf "| all | %d of %d, %.0f %% | %d of %d, %.0f %% | | |\n", lone, sums, 100 * lone / sums, honest, sum, 100 * honest / sum
}

function figures(    s) {
    for (s = 1; s <= scenes; s++) {
        if (system("cp " tables(s) "accuracy.svg docs/images/accuracy-" scene[s] ".svg") != 0) fault("no figure of " scene[s])
        print "\n![Error against time: " scene[s] "](../images/accuracy-" scene[s] ".svg)"
    }
}

BEGIN {
    # Presets and estimates are those of the first four; of `cloud`, which has no contacts, what self-gravity does.
    scenes = split("collapse rest spin heap cloud", scene, " ") - 1
    split("draft standard fine reference lmgc90", preset, " ")
    # The seeds of study.ron.
    realisations = split("5 12 13", seed, " "); split("2 12 13", heap_seed, " ")
    for (s = 1; s <= scenes; s++) realised(s)
    groups = split("dt tol penetration_tol max_sweeps theta adaptive alert gravity_error gravity_refresh gravity_order gravity_opening", group, " ")
}

/^<!-- [a-z]+: begin -->$/ && $2 ~ /^(presets|many|knobs|early|honesty|figures):$/ {
    print; print ""
    if ($2 == "presets:") { presets(); print ""; verdict(); statements() } else if ($2 == "knobs:") knobs("", scenes, groups - 2); else if ($2 == "early:") { knobs("_early", scenes + 1, groups); print ""; instead("heap", "heap-" heap_seed[1], "fast", "narrow_phase: fast"); instead("cloud", "cloud", "direct", "gravity: direct") } else if ($2 == "many:") many(); else if ($2 == "honesty:") honesty(); else figures()
    print ""; skipping = 1
    next
}
/^<!-- [a-z]+: end -->$/ { skipping = 0 }
!skipping { print }

END { if (failed) exit 1 }
