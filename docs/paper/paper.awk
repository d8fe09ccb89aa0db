# Writes a page of docs/explanation/paper from docs/paper/NAME.md.in, at the top folder of the project:
#   awk -f docs/paper/paper.awk docs/paper/NAME.md.in > docs/explanation/paper/NAME.md
# Lines pass as they are, but
#   @figure FILE NAME CAPTION...            copies the figure to docs/images/paper-NAME.svg and shows it; lines that follow each
#                                           other make a table of two a row
#   @table FILE COLUMN,COLUMN...            a table of columns of a CSV file; text as it is, numbers to four digits
#   @shares FILE GROUP                      a table of the share of each stage in the cost against the number of grains, of a group of runs.csv
#   @columns CLAIM                          heads of a table of claims
#   @claim LOW HIGH NUMBER | CLAIM | WHERE | REMARK   a row: agrees if LOW <= NUMBER <= HIGH; `-` is no bound
# NUMBER is one of
#   cell FILE COLUMN KEY=VALUE...           of the first row that has these; KEY~PART: whose KEY holds PART
#   over FILE COLUMN KEY=VALUE... / COLUMN KEY=VALUE...   one cell over another
#   less FILE COLUMN KEY=VALUE... / COLUMN KEY=VALUE...   one cell less another; of both, the second may be `/ FILE COLUMN...`
#   share FILE COLUMN TIME                  the column at a time over its largest value
#   ratio FILE COLUMN TIME TIME             the column at the second time over that at the first
#   range FILE COLUMN TIME TIME             largest less smallest value between two times
#   wider FILE COLUMN TIME TIME / FILE      that range over the range of another file
#   spread FILE COLUMN TIME TIME            standard deviation over mean between two times
#   periodic FILE COLUMN PERIOD TIME TIME   share of the variance of its changes from row to row that goes with the time within the period
#   climb FILE COLUMN                       smallest ratio of a row to the one before
#   last FILE COLUMN                        the column in the last row
# Several numbers at once have what differs in braces, once or more often: {250,500} is 250 in the first and 500 in the second. The row
# shows the smallest and the largest and agrees if all do.
# An empty or missing number is a fault: the paper says nothing that was not measured.

function fault(text) { print FILENAME ":" FNR ": " text > "/dev/stderr"; failed = 1; exit 1 }

# Reads a CSV file once: head[file, name] = column, cells[file, row, column], rows[file].
function load(file,    line, parts, k, n, row) {
    if (file in rows) return
    row = -1
    while ((getline line < file) > 0) {
        n = split(line, parts, ",")
        if (++row == 0) for (k = 1; k <= n; k++) head[file, parts[k]] = k
        else for (k = 1; k <= n; k++) cells[file, row, k] = parts[k]
    }
    close(file)
    if (row < 1) fault(file ": no table; run the examples first")
    rows[file] = row
}

function value(file, row, name,    column) {
    if (!((file, name) in head)) fault(file ": no column " name)
    column = cells[file, row, head[file, name]]
    if (column == "") fault(file ": no " name " in row " row)
    return column
}

# The row of a time, to a thousandth.
function row_at(file, time,    k, t) {
    for (k = 1; k <= rows[file]; k++) {
        t = value(file, k, "time")
        if (t > time - 1e-3 * time - 1e-9 && t < time + 1e-3 * time + 1e-9) return k
    }
    fault(file ": no row of " time " s")
}

# Of the words from `first` to `last`: column, then conditions.
function cell(file, words, first, last,    k, j, pair, fits) {
    for (k = 1; k <= rows[file]; k++) {
        fits = 1
        for (j = first + 1; j <= last; j++)
            if (words[j] ~ /=/) { split(words[j], pair, "="); if (value(file, k, pair[1]) != pair[2]) fits = 0 }
            else { split(words[j], pair, "~"); if (!index(value(file, k, pair[1]), pair[2])) fits = 0 }
        if (fits) return value(file, k, words[first])
    }
    fault(file ": no such row")
}

function climb(file, name,    k, ratio, least) {
    for (k = 2; k <= rows[file]; k++) {
        ratio = value(file, k, name) / value(file, k - 1, name)
        if (k == 2 || ratio < least) least = ratio
    }
    return least
}

function range(file, name, first, last,    k, x, to, low, high) {
    k = row_at(file, first); to = row_at(file, last); low = high = value(file, k, name) + 0
    for (; k <= to; k++) { x = value(file, k, name) + 0; if (x < low) low = x; if (x > high) high = x }
    return high - low
}

function spread(file, name, from, to,    k, x, sum, squares, n) {
    n = to - from + 1
    for (k = from; k <= to; k++) { x = value(file, k, name); sum += x; squares += x * x }
    return sqrt(squares / n - (sum / n) ^ 2) / (sum / n)
}

# Changes by their place in the period: variance of the means of the places over that of all.
function periodic(file, name, period, from, to,    k, d, place, n, sum, squares, of, many, between) {
    for (k = from + 1; k <= to; k++) {
        d = value(file, k, name) - value(file, k - 1, name)
        place = sprintf("%.3f", value(file, k, "time") % period)
        n++; sum += d; squares += d * d; of[place] += d; many[place]++
    }
    for (place in of) between += of[place] ^ 2 / many[place]
    return (between - sum * sum / n) / (squares - sum * sum / n)
}

# Text with the k-th alternative of each pair of braces; the text itself if there is none.
function variant(text, k,    parts) {
    while (match(text, /\{[^}]*\}/)) {
        split(substr(text, RSTART + 1, RLENGTH - 2), parts, ",")
        text = substr(text, 1, RSTART - 1) parts[k] substr(text, RSTART + RLENGTH)
    }
    return text
}
function variants(text,    parts) {
    return match(text, /\{[^}]*\}/) ? split(substr(text, RSTART + 1, RLENGTH - 2), parts, ",") : 1
}

function number(words, n,    file, name, k, x, y, low, high, from, to) {
    file = words[2]; name = words[3]; load(file)
    if (words[1] == "cell") return cell(file, words, 3, n)
    if (words[1] == "over" || words[1] == "less") {
        for (k = 3; k < n && words[k] != "/"; k++) ;
        x = cell(file, words, 3, k - 1)
        if (words[k + 1] ~ /\.csv$/) { file = words[++k]; load(file) }
        y = cell(file, words, k + 1, n)
        return words[1] == "over" ? x / y : x - y
    }
    if (words[1] == "climb") return climb(file, name)
    if (words[1] == "spread") return spread(file, name, row_at(file, words[4]), row_at(file, words[5]))
    if (words[1] == "periodic") return periodic(file, name, words[4], row_at(file, words[5]), row_at(file, words[6]))
    if (words[1] == "last") return value(file, rows[file], name)
    if (words[1] == "ratio") return value(file, row_at(file, words[5]), name) / value(file, row_at(file, words[4]), name)
    if (words[1] == "range") return range(file, name, words[4], words[5])
    if (words[1] == "wider") { x = range(file, name, words[4], words[5]); file = words[7]; load(file); return x / range(file, name, words[4], words[5]) }
    if (words[1] == "share") { from = 1; to = row_at(file, words[4]) }
    else fault("no number '" words[1] "'")
    high = value(file, from, name) + 0
    for (k = from; k <= to; k++) { x = value(file, k, name) + 0; if (x > high) high = x }
    return value(file, to, name) / high
}

function shown(text) { return text ~ /^-?[0-9.]+(e[-+]?[0-9]+)?$/ ? sprintf("%.4g", text) : text }

$1 == "@figure" {
    caption = $0; sub(/^@figure +[^ ]+ +[^ ]+ +/, "", caption)
    if (system("cp " $2 " docs/images/paper-" $3 ".svg") != 0) fault("no figure " $2)
    pictures[++figures] = "![" caption "](../../images/paper-" $3 ".svg)"; captions[figures] = caption
    next
}

{ show_figures() }

function show_figures(    k) {
    if (figures == 1) print pictures[1] "\n\n" captions[1]
    else for (k = 1; k <= figures; k += 2) {
        print "| " pictures[k] " | " (k < figures ? pictures[k + 1] : "") " |"
        if (k == 1) print "|---|---|"
        print "| " captions[k] " | " (k < figures ? captions[k + 1] : "") " |"
    }
    figures = 0
}

$1 == "@table" {
    load($2); n = split($3, names, ","); line = "|"; rule = "|"
    for (k = 1; k <= n; k++) { line = line " " names[k] " |"; rule = rule "---|" }
    print line; print rule
    for (r = 1; r <= rows[$2]; r++) {
        line = "|"
        for (k = 1; k <= n; k++) line = line " " shown(value($2, r, names[k])) " |"
        print line
    }
    next
}

$1 == "@shares" {
    load($2)
    print "| grains | seconds a step | gravity | detection | contacts | the rest |\n|---|---|---|---|---|---|"
    for (r = 1; r <= rows[$2]; r++) {
        if (value($2, r, "group") != $3) continue
        all = value($2, r, "seconds")
        gravity = value($2, r, "seconds_gravity") / all; detection = value($2, r, "seconds_detection") / all; contacts = value($2, r, "seconds_contacts") / all
        printf "| %d | %.3g | %.0f %% | %.0f %% | %.0f %% | %.0f %% |\n", value($2, r, "n_grains"), all, 100 * gravity, 100 * detection, 100 * contacts, \
            100 * (1 - gravity - detection - contacts)
    }
    next
}

$1 == "@columns" { print "| the paper says | where to look | measured | expected | verdict | |\n|---|---|---|---|---|---|"; next }

$1 == "@claim" {
    split($0, parts, / *\| */)
    agrees = 1; least = most = ""
    for (v = 1; v <= variants(parts[1]); v++) {
        n = split(variant(parts[1], v), words, " ")
        low = words[2]; high = words[3]
        for (k = 4; k <= n; k++) words[k - 3] = words[k]
        x = number(words, n - 3)
        if (!((low == "-" || x >= low + 0) && (high == "-" || x <= high + 0))) agrees = 0
        if (least == "" || x + 0 < least + 0) least = x
        if (most == "" || x + 0 > most + 0) most = x
    }
    measured = v > 2 ? shown(least) " to " shown(most) : shown(x)
    bounds = low == "-" ? "at most " high : high == "-" ? "at least " low : low " to " high
    printf "| %s | %s | %s | %s | %s | %s |\n", parts[2], parts[3], measured, bounds, agrees ? "agrees" : "**differs**", parts[4]
    next
}

{ print }

END { if (failed) exit 1; show_figures() }
