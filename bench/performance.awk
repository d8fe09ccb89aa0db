# Draws the tables of docs/explanation/performance.md from the measurements of one machine:
#   LC_ALL=C awk -f bench/performance.awk docs/explanation/performance.md > docs/explanation/performance.md.part
# Reads: docs/explanation/performance.md; bench/results/MACHINE/*.csv and machine.txt.
# Writes: the page to the standard output; with `-v machine=NAME` for another machine than that of the page.
#
# The page names its machine once, and before each table its file and layout:
#   <!-- machine NAME -->
#   <!-- table FILE | rows FIELD... | columns FIELD... [| only FIELD=VALUE/VALUE...[; FIELD=...]] [| else NAME] [| of NAME] -->
# Lines from there to `<!-- end -->` are replaced. Fields are those of the CSV file; rows and columns come in its order.
# `only` keeps lines whose fields have one of the values, and orders columns by them. `else` names the machine whose file
# is taken if the machine of the page has none; `of` the one whose file is taken unless `-v machine` has one. Lines that
# differ in their value alone are repeated measurements: the table shows their range.

function fault(text) { print FILENAME ":" FNR ": " text > "/dev/stderr"; failed = 1; exit 1 }

# Value of the part `| NAME VALUE` of a marker, or nothing.
function marker_part(marker, name,    parts, n, k) {
    sub(/^<!-- /, "", marker); sub(/ *-->$/, "", marker)
    n = split(marker, parts, / *[|] */)
    for (k = 1; k <= n; k++) if (index(parts[k], name " ") == 1) return substr(parts[k], length(name) + 2)
    return ""
}

# Whole number of five digits or more in groups of three; any other text unchanged.
function grouped(text,    groups) {
    if (text !~ /^[0-9][0-9][0-9][0-9][0-9]+$/) return text
    for (; length(text) > 3; text = substr(text, 1, length(text) - 3)) groups = " " substr(text, length(text) - 2) groups
    return text groups
}

# Values of the fields of the present line, joined by a separator.
function joined_fields(names, separator,    fields, n, k, text, one) {
    n = split(names, fields, " ")
    for (k = 1; k <= n; k++) {
        if (!(fields[k] in cell)) fault(fields[k] ": not a column of the CSV file")
        one = grouped(cell[fields[k]])
        # In the head of a column the number alone would say nothing.
        if (fields[k] == "threads" && separator == ", ") one = one (one == 1 ? " thread" : " threads")
        text = text (k > 1 ? separator : "") one
    }
    return text
}

# Whether the present line fulfils the conditions `FIELD=VALUE/VALUE...; FIELD=...`.
function is_kept(conditions,    parts, n, k, pair) {
    n = split(conditions, parts, / *; */)
    for (k = 1; k <= n; k++) {
        split(parts[k], pair, "=")
        if (!(pair[1] in cell)) fault("only: " pair[1] ": not a column of the CSV file")
        if (index("/" pair[2] "/", "/" cell[pair[1]] "/") == 0) return 0
    }
    return 1
}

function exists(file,    line, found) { found = (getline line < file) > 0; close(file); return found }

function csv_file(marker, name,    own, other) {
    own = "bench/results/" machine "/" name ".csv"
    other = marker_part(marker, "of")
    if (other == "" || (is_given && exists(own))) other = exists(own) ? "" : marker_part(marker, "else")
    return other == "" ? own : "bench/results/" other "/" name ".csv"
}

# Values that the condition `only` lists for the field of the columns, in their order, into column_names.
function order_columns(marker,    field, parts, n, k, values, count, j) {
    field = marker_part(marker, "columns")
    n = split(marker_part(marker, "only"), parts, / *; */)
    for (k = 1; k <= n; k++) {
        if (index(parts[k], field "=") != 1) continue
        count = split(substr(parts[k], length(field) + 2), values, "/")
        for (j = 1; j <= count; j++) column_names[++column_count] = values[j]
    }
}

# Reads the kept lines of a CSV file into the arrays of the table: rows, columns, units, least and largest values.
function load_table(file, marker,    line, names, values, n, k, lines, row, column, key) {
    row_count = column_count = 0
    split("", row_names); split("", column_names); split("", known); split("", unit); split("", least); split("", largest)
    order_columns(marker)
    for (k = 1; k <= column_count; k++) known["column", column_names[k]]
    while ((getline line < file) > 0) {
        n = split(line, values, ",")
        if (++lines == 1) { split(line, names, ","); continue }
        for (k = 1; k <= n; k++) cell[names[k]] = values[k]
        if (!is_kept(marker_part(marker, "only"))) continue
        row = joined_fields(marker_part(marker, "rows"), " | ")
        column = joined_fields(marker_part(marker, "columns"), ", ")
        if (!(("row", row) in known)) { known["row", row]; row_names[++row_count] = row }
        if (!(("column", column) in known)) { known["column", column]; column_names[++column_count] = column }
        if (!(column in unit)) unit[column] = cell["unit"]
        if (unit[column] != cell["unit"]) fault(file ": " column ": units " unit[column] " and " cell["unit"] "; expected one")
        key = row SUBSEP column
        if (!(key in least)) least[key] = largest[key] = cell["value"]
        if (cell["value"] + 0 < least[key] + 0) least[key] = cell["value"]
        if (cell["value"] + 0 > largest[key] + 0) largest[key] = cell["value"]
    }
    close(file)
}

# Unit of most columns, stated above the table and not in their heads.
function common_unit(    j, count, most, found) {
    for (j = 1; j <= column_count; j++) {
        if (unit[column_names[j]] != "" && ++count[unit[column_names[j]]] > most) { found = unit[column_names[j]]; most = count[found] }
    }
    return found
}

function print_table(file, rows,    fields, n, j, k, line, rule, column, key, common) {
    common = common_unit()
    n = split(rows, fields, " ")
    for (k = 1; k <= n; k++) { line = line "| " fields[k] " "; rule = rule "|---" }
    for (j = 1; j <= column_count; j++) {
        column = column_names[j]
        if (!(column in unit)) continue
        line = line "| " column (unit[column] != "" && unit[column] != common ? ", " unit[column] : "") " "
        rule = rule "|---"
    }
    print (common != "" ? "In " common ", from" : "From") " [" substr(file, 15) "](../../" file "):\n"
    print line "|\n" rule "|"
    for (k = 1; k <= row_count; k++) {
        line = "| " row_names[k] " |"
        for (j = 1; j <= column_count; j++) {
            if (!(column_names[j] in unit)) continue
            key = row_names[k] SUBSEP column_names[j]
            line = line (key in least ? " " grouped(least[key]) (least[key] + 0 < largest[key] + 0 ? " to " grouped(largest[key]) : "") : "") " |"
        }
        print line
    }
}

BEGIN { is_given = machine != "" }
/^<!-- machine / {
    if (machine == "") machine = marker_part($0, "machine")
    file = "bench/results/" machine "/machine.txt"
    if (!exists(file)) fault(file ": absent; expected a description of the machine")
    print "<!-- machine " machine " -->"
    while ((getline line < file) > 0) print line
    close(file)
    is_replaced = 1; next
}
/^<!-- table / {
    if (machine == "") fault("a table before `<!-- machine NAME -->`")
    print
    file = csv_file($0, marker_part($0, "table"))
    load_table(file, $0)
    if (row_count == 0) print "Not measured: there is no such line in " file "."
    else print_table(file, marker_part($0, "rows"))
    is_replaced = 1; next
}
/^<!-- end -->/ { if (!is_replaced) fault("`<!-- end -->` without a beginning"); is_replaced = 0 }
!is_replaced { print }
END { if (!failed && is_replaced) fault("no `<!-- end -->`"); exit failed }
