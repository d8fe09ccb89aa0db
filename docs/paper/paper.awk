# Writes a page of docs/explanation/paper from docs/paper/NAME.md.in, at the top folder of the project:
#   awk -f docs/paper/paper.awk docs/paper/NAME.md.in > docs/explanation/paper/NAME.md
# Lines pass as they are, but
#   @figure FILE NAME CAPTION...            copies the figure to docs/images/paper-NAME.svg and shows it; lines that follow each
#                                           other make a table of two a row
#   @means FILE SETS QUANTITIES [KEY=VALUE...]   a table of means.csv of `cd-post study`: a row a set of parameters, mean ± standard error
#   @table FILE KEYS COLUMNS [KEY=VALUE...]      the same of any CSV file: a row for rows of equal keys but for the seed
#   @shares FILE GROUP                      a table of the share of each stage in the cost against the number of grains, of a group of runs.csv
#   @costs NAME...                          a table of the studies in examples/NAME: runs, and seconds of a core by docs/paper/NAME.times
#   @columns                                heads of a table of claims
#   @claim LOW HIGH NUMBER | CLAIM | WHERE | SOURCE | REMARK   a row; LOW and HIGH are bounds, `-` is no bound; SOURCE: value of the source
# Lists of SETS, QUANTITIES, KEYS, COLUMNS have commas; NAME:TEXT in them is the column NAME under the head TEXT.
#
# NUMBER is evaluated for each of the seeds 1 to SEEDS, which stand in the place of the word SEED. The row shows the mean and half the width of its
# 95 % confidence interval by Student's t. It agrees if the whole interval is within the bounds, differs if none of it is, and is open otherwise.
# NUMBER is one of
#   cell FILE COLUMN KEY=VALUE...           of the first row that has these; KEY~PART: whose KEY holds PART
#   over FILE COLUMN KEY=VALUE... / COLUMN KEY=VALUE...   one cell over another
#   less FILE COLUMN KEY=VALUE... / COLUMN KEY=VALUE...   one cell less another; of both, the second may be `/ FILE COLUMN...`
#   least FILE COLUMN KEY=VALUE...          smallest of all rows that have these
#   climb FILE COLUMN KEY=VALUE...          smallest ratio of such a row to the one before
#   slope FILE Y X KEY=VALUE...             of the line of least squares through such rows; Y, X: COLUMN, COLUMN^POWER or ln(COLUMN)
#   intercept, linearity FILE Y X KEY=VALUE...   its value at 0; the square of the correlation
#   straighter FILE Y X KEY=VALUE... / Y    linearity less that of another Y
#   share FILE COLUMN TIME                  the column at a time over its largest value
#   ratio FILE COLUMN TIME TIME             the column at the second time over that at the first
#   range FILE COLUMN TIME TIME             largest less smallest value between two times
#   wider FILE COLUMN TIME TIME / FILE      that range over the range of another file
#   grown FILE COLUMN OTHER FACTOR / FILE   the same range, in each file from the start until OTHER exceeds FACTOR times its first value
#   spread FILE COLUMN TIME TIME            standard deviation over mean between two times
#   periodic FILE COLUMN PERIOD TIME TIME   share of the variance of its changes from row to row that goes with the time within the period
#   last FILE COLUMN                        the column in the last row
# Several numbers at once have what differs in braces, once or more often: {250,500} is 250 in the first and 500 in the second. The row
# shows the range of their means, with the widest interval; it agrees if all do, and differs if one does.
# An empty or missing number is a fault: the paper says nothing that was not measured.

BEGIN { if (!SEEDS) SEEDS = 5; split("12.706 4.303 3.182 2.776 2.571 2.447 2.365 2.306 2.262", STUDENT, " ") }

function fault(text) { print FILENAME ":" FNR ": " text > "/dev/stderr"; failed = 1; exit 1 }

# Reads a CSV file once: head[file, name] = column, lines[file, row], rows[file].
function load(file,    line, parts, k, n, row) {
    if (file in rows) return
    row = -1
    while ((getline line < file) > 0) {
        if (++row) { lines[file, row] = line; continue }
        n = split(line, parts, ",")
        for (k = 1; k <= n; k++) head[file, parts[k]] = k
    }
    close(file)
    if (row < 1) fault(file ": no table; run the examples first")
    rows[file] = row
}

# A cell, empty where the table has nothing.
function raw(file, row, name) {
    if (!((file, name) in head)) fault(file ": no column " name)
    if (split_file != file || split_row != row) { split(lines[file, row], fields, ","); split_file = file; split_row = row }
    return fields[head[file, name]]
}

function value(file, row, name,    text) {
    text = raw(file, row, name)
    if (text == "") fault(file ": no " name " in row " row)
    return text
}

# The row of a time, to a thousandth.
function row_at(file, time,    k, t) {
    for (k = 1; k <= rows[file]; k++) {
        t = value(file, k, "time")
        if (t > time - 1e-3 * time - 1e-9 && t < time + 1e-3 * time + 1e-9) return k
    }
    fault(file ": no row of " time " s")
}

# Whether a row has what the words from `first` to `last` require; words without `=` and `~` require nothing.
function fits(file, row, words, first, last,    j, pair) {
    for (j = first; j <= last; j++) {
        if (split(words[j], pair, "=") == 2) { if (value(file, row, pair[1]) != pair[2]) return 0 }
        else if (split(words[j], pair, "~") == 2 && !index(value(file, row, pair[1]), pair[2])) return 0
    }
    return 1
}

# Of the words from `first` to `last`: column, then conditions.
function cell(file, words, first, last,    k) {
    for (k = 1; k <= rows[file]; k++) if (fits(file, k, words, first + 1, last)) return value(file, k, words[first])
    fault(file ": no such row")
}

function least(file, words, last,    k, x, low) {
    for (k = 1; k <= rows[file]; k++) if (fits(file, k, words, 4, last)) { x = value(file, k, words[3]) + 0; if (low == "" || x < low) low = x }
    return low
}

function climb(file, words, last,    k, x, before, low) {
    for (k = 1; k <= rows[file]; k++) if (fits(file, k, words, 4, last)) {
        x = value(file, k, words[3])
        if (before != "" && (low == "" || x / before < low)) low = x / before
        before = x
    }
    return low
}

# COLUMN, COLUMN^POWER or ln(COLUMN) in a row.
function term(file, row, text,    pair) {
    if (text ~ /^ln\(/) return log(value(file, row, substr(text, 4, length(text) - 4)))
    return split(text, pair, "^") == 2 ? value(file, row, pair[1]) ^ pair[2] : value(file, row, text)
}

# Line of least squares through the rows that fit: `fit_slope`, `fit_intercept`, `fit_r2`.
function fit(file, words, last,    k, x, y, n, sx, sy, sxx, sxy, syy) {
    for (k = 1; k <= rows[file]; k++) if (fits(file, k, words, 5, last)) {
        y = term(file, k, words[3]); x = term(file, k, words[4])
        n++; sx += x; sy += y; sxx += x * x; sxy += x * y; syy += y * y
    }
    if (n < 3) fault(file ": a line through " (n + 0) " rows")
    sxx -= sx * sx / n; sxy -= sx * sy / n; syy -= sy * sy / n
    fit_slope = sxy / sxx; fit_intercept = (sy - fit_slope * sx) / n; fit_r2 = sxy * sxy / (sxx * syy)
}

function range(file, name, first, last,    k, x, to, low, high) {
    k = row_at(file, first); to = row_at(file, last); low = high = value(file, k, name) + 0
    for (; k <= to; k++) { x = value(file, k, name) + 0; if (x < low) low = x; if (x > high) high = x }
    return high - low
}

# Range of a column until another has grown by a factor.
function range_until(file, name, other, factor,    k) {
    for (k = 1; k < rows[file] && value(file, k, other) <= factor * value(file, 1, other); k++) ;
    return range(file, name, value(file, 1, "time"), value(file, k, "time"))
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

# Position of the word `/`, or one after the last.
function slash(words, n,    k) { for (k = 3; k <= n && words[k] != "/"; k++) ; return k }

# One cell over another, or less another.
function of_two(words, n,    file, k, x, y) {
    file = words[2]; k = slash(words, n)
    x = cell(file, words, 3, k - 1)
    if (words[k + 1] ~ /\.csv$/) { file = words[++k]; load(file) }
    y = cell(file, words, k + 1, n)
    return words[1] == "over" ? x / y : x - y
}

function fitted(words, n,    k, r2) {
    k = slash(words, n)
    fit(words[2], words, k - 1)
    if (words[1] == "slope") return fit_slope
    if (words[1] == "intercept") return fit_intercept
    if (words[1] == "linearity") return fit_r2
    r2 = fit_r2; words[3] = words[k + 1]
    fit(words[2], words, k - 1)
    return r2 - fit_r2
}

function number(words, n,    file, name, k, x, high, to) {
    file = words[2]; name = words[3]; load(file)
    if (words[1] == "cell") return cell(file, words, 3, n)
    if (words[1] == "over" || words[1] == "less") return of_two(words, n)
    if (words[1] == "least") return least(file, words, n)
    if (words[1] == "climb") return climb(file, words, n)
    if (words[1] ~ /^(slope|intercept|linearity|straighter)$/) return fitted(words, n)
    if (words[1] == "spread") return spread(file, name, row_at(file, words[4]), row_at(file, words[5]))
    if (words[1] == "periodic") return periodic(file, name, words[4], row_at(file, words[5]), row_at(file, words[6]))
    if (words[1] == "last") return value(file, rows[file], name)
    if (words[1] == "ratio") return value(file, row_at(file, words[5]), name) / value(file, row_at(file, words[4]), name)
    if (words[1] == "range") return range(file, name, words[4], words[5])
    if (words[1] == "wider") { x = range(file, name, words[4], words[5]); file = words[7]; load(file); return x / range(file, name, words[4], words[5]) }
    if (words[1] == "grown") { load(words[7]); return range_until(file, name, words[4], words[5]) / range_until(words[7], name, words[4], words[5]) }
    if (words[1] != "share") fault("no number '" words[1] "'")
    to = row_at(file, words[4])
    for (k = 1; k <= to; k++) { x = value(file, k, name) + 0; if (k == 1 || x > high) high = x }
    return value(file, to, name) / high
}

# Mean of a number over the seeds: `mean`, and `half` the width of its interval.
function replicate(text,    seed, words, n, x, sum, squares, once) {
    sum = squares = 0
    for (seed = 1; seed <= SEEDS; seed++) {
        once = text; gsub(/SEED/, seed, once)
        n = split(once, words, " ")
        x = number(words, n)
        if (x !~ /^[-+]?[0-9.]+(e[-+]?[0-9]+)?$/) fault(once ": no number")
        if (seed == 1) first_value = x + 0
        sum += x - first_value; squares += (x - first_value) ^ 2
    }
    mean = first_value + sum / SEEDS
    half = STUDENT[SEEDS - 1] * sqrt(larger(0, squares - sum * sum / SEEDS) / (SEEDS - 1) / SEEDS)
}

function larger(a, b) { return a > b ? a : b }

# Power of ten of the first digit.
function magnitude(x,    e) {
    if (x < 0) x = -x
    e = 0
    while (x >= 10) { x /= 10; e++ }
    while (x > 0 && x < 1) { x *= 10; e-- }
    return e
}

# A number to the second digit of its error.
function rounded(x, error,    digits) {
    if (error <= 1e-6 * (x < 0 ? -x : x)) return sprintf("%.6g", x)
    digits = 1 - magnitude(error)
    if (magnitude(x) < -3 && x != 0) return sprintf("%.*e", larger(0, magnitude(x) + digits), x)
    return sprintf("%.*f", larger(0, digits), x)
}
function with_error(x, error) {
    if (error <= 1e-9 * (x < 0 ? -x : x)) error = 0
    if ((x < 0 ? -x : x) <= 1e-9 * error) x = 0 # a sum of rounding errors
    return rounded(x, error) " ± " (error > 0 && magnitude(error) < -4 ? sprintf("%.1e", error) : error > 0 ? rounded(error, error) : 0)
}

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

# Heads of a table: the names of two lists of columns, or what stands behind their colons. Names are left in `keys`, `names`.
function table_heads(first, second,    k, pair, line, rule) {
    key_count = split(first, keys, ","); name_count = split(second, names, ",")
    line = rule = "|"
    for (k = 1; k <= key_count + name_count; k++) {
        split(k <= key_count ? keys[k] : names[k - key_count], pair, ":")
        if (k <= key_count) keys[k] = pair[1]; else names[k - key_count] = pair[1]
        line = line " " (pair[2] == "" ? pair[1] : pair[2]) " |"; rule = rule "---|"
    }
    print line "\n" rule
}

# Keys of a row, without the seed, as cells of a table.
function set_of(file, row,    k, text, cell_text) {
    text = ""
    for (k = 1; k <= key_count; k++) {
        cell_text = value(file, row, keys[k])
        sub(/-s[0-9]+$/, "", cell_text); sub(/^s[0-9]+\//, "", cell_text); sub(/-s[0-9]+\//, "/", cell_text)
        text = text " " cell_text " |"
    }
    return text
}

# Sets of the rows that fit, in their order: `sets`, `set_count`.
function find_sets(file, words, n,    r, set, known) {
    set_count = 0; split("", known)
    for (r = 1; r <= rows[file]; r++) {
        if (!fits(file, r, words, 5, n)) continue
        set = set_of(file, r)
        if (!(set in known)) { known[set] = 1; sets[++set_count] = set }
    }
}

$1 == "@means" {
    load($2); n = split($0, words, " "); table_heads($3, $4); find_sets($2, words, n)
    for (s = 1; s <= set_count; s++) {
        line = "|" sets[s]
        for (k = 1; k <= name_count; k++) {
            found = "-"
            for (r = 1; r <= rows[$2]; r++)
                if (raw($2, r, "quantity") == names[k] && raw($2, r, "mean") != "" && fits($2, r, words, 5, n) && set_of($2, r) == sets[s])
                    found = with_error(raw($2, r, "mean"), raw($2, r, "standard_error"))
            line = line " " found " |"
        }
        print line
    }
    next
}

$1 == "@table" {
    load($2); n = split($0, words, " "); table_heads($3, $4); find_sets($2, words, n)
    for (s = 1; s <= set_count; s++) {
        line = "|" sets[s]
        for (k = 1; k <= name_count; k++) line = line " " mean_of_set($2, words, n, sets[s], names[k]) " |"
        print line
    }
    next
}

# Mean ± standard error of a column over the rows of a set that have a number.
function mean_of_set(file, words, n, set, name,    r, x, many, first, sum, squares) {
    for (r = 1; r <= rows[file]; r++) {
        if (!fits(file, r, words, 5, n) || set_of(file, r) != set) continue
        x = raw(file, r, name)
        if (x == "" || x == "-") continue
        if (!many++) first = x
        sum += x - first; squares += (x - first) ^ 2
    }
    if (!many) return "-"
    if (many == 1) return sprintf("%.4g", first)
    return with_error(first + sum / many, sqrt(larger(0, squares - sum * sum / many) / (many - 1) / many))
}

$1 == "@shares" {
    load($2); grains = 0
    print "| grains | seconds a step | gravity | detection | contacts | the rest |\n|---|---|---|---|---|---|"
    for (r = 1; r <= rows[$2]; r++) {
        if (value($2, r, "group") != $3) continue
        at = value($2, r, "n_grains")
        if (!(at in runs_at)) number_at[++grains] = at
        runs_at[at]++; all[at] += value($2, r, "seconds"); gravity[at] += value($2, r, "seconds_gravity")
        detection[at] += value($2, r, "seconds_detection"); contacts[at] += value($2, r, "seconds_contacts")
    }
    for (k = 1; k <= grains; k++) {
        at = number_at[k]
        printf "| %d | %.3g | %.0f %% | %.0f %% | %.0f %% | %.0f %% |\n", at, all[at] / runs_at[at], 100 * gravity[at] / all[at], 100 * detection[at] / all[at], \
            100 * contacts[at] / all[at], 100 * (1 - (gravity[at] + detection[at] + contacts[at]) / all[at])
    }
    split("", runs_at); split("", all); split("", gravity); split("", detection); split("", contacts)
    next
}

# Seconds of a core in a file that the command `times` of the shell has written: of each pair of lines the second has those of the programs.
function core_seconds(file,    line, parts, k, pair, rows_read, sum) {
    while ((getline line < file) > 0) {
        if (++rows_read % 2) continue
        split(line, parts, " ")
        for (k = 1; k <= 2; k++) { split(parts[k], pair, "m"); sum += 60 * pair[1] + pair[2] }
    }
    close(file)
    if (!rows_read) fault(file ": is not there; run `make paper`")
    return sum
}

$1 == "@costs" {
    print "| study | runs | seconds of a core |\n|---|---|---|"
    for (k = 2; k <= NF; k++) {
        file = "examples/" $k "/study.csv"; load(file); many = rows[file]
        if ($k == "spin-up") { file = "examples/spin-up/fluid.csv"; load(file); many += rows[file] }
        seconds = core_seconds("docs/paper/" $k ".times")
        printf "| [%s](../../../examples/%s/README.md) | %d | %.0f |\n", $k, $k, many, seconds
        all_runs += many; all_seconds += seconds
    }
    printf "| all | %d | %.0f |\n", all_runs, all_seconds
    next
}

$1 == "@columns" { print "| statement | where to look | measured | expected | verdict | |\n|---|---|---|---|---|---|"; next }

# Verdict on the interval mean ± half.
function verdict(low, high) {
    if ((low == "-" || mean - half >= low + 0) && (high == "-" || mean + half <= high + 0)) return "agrees"
    return low != "-" && mean + half < low + 0 || high != "-" && mean - half > high + 0 ? "**differs**" : "open"
}

$1 == "@claim" {
    split($0, parts, / *\| */)
    least_mean = most_mean = ""; widest = 0; all_agree = 1; one_differs = 0
    for (v = 1; v <= variants(parts[1]); v++) {
        text = variant(parts[1], v); split(text, words, " "); low = words[2]; high = words[3]
        sub(/^@claim +[^ ]+ +[^ ]+ +/, "", text)
        replicate(text)
        judged = verdict(low, high)
        if (judged != "agrees") all_agree = 0
        if (judged == "**differs**") one_differs = 1
        if (least_mean == "" || mean < least_mean) least_mean = mean
        if (most_mean == "" || mean > most_mean) most_mean = mean
        widest = larger(widest, half)
    }
    measured = v > 2 && least_mean != most_mean ? rounded(least_mean, widest) " to " with_error(most_mean, widest) : with_error(most_mean, widest)
    bounds = low == "-" ? "at most " high : high == "-" ? "at least " low : low " to " high
    printf "| %s | %s | %s | %s | %s | %s |\n", parts[2], parts[3], measured, (parts[4] == "" ? "" : parts[4] "; ") bounds, \
        all_agree ? "agrees" : one_differs ? "**differs**" : "open", parts[5]
    next
}

{ print }

END { if (failed) exit 1; show_figures() }
