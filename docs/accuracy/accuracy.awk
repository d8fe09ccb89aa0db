# Writes the results of `make -C examples/accuracy-study` into docs/explanation/accuracy.md, between its marks, and the help texts of the
# presets into formats/src/accuracy/PRESET.txt; at the top folder of the project:
#   awk -f docs/accuracy/accuracy.awk docs/explanation/accuracy.md > docs/explanation/accuracy.md.part
# With -v section=NAME only between the marks of this name: targets, for one, after `make -C examples/accuracy-study targets` alone.
# Numbers come from examples/accuracy-study/figures/SCENE/{accuracy,orders}.csv, of all realisations together, figures/SCENE-SEED/accuracy.csv, of
# each, and figures/SCENE/{chosen,validated,targets}/{bias,settings}.csv alone.
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
    if (!(file in rows)) load(file)
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

# Tables of a scene: `chosen` of the seeds by which the presets were chosen, `validated` of the others, both by
# `make -C examples/accuracy-study presets`, and `targets` by `make -C examples/accuracy-study targets`.
function study(name, kind, table) { return "examples/accuracy-study/figures/" name "/" kind "/" table ".csv" }

# Name of the setting of a row; `cd-post` puts names with hyphens between quotes.
function setting_name(file, k,    name) {
    name = value(file, k, "setting"); sub(/^setting /, "", name); gsub(/\047/, "", name)
    return name
}

# Number in a column of a table, of a setting and, in bias.csv, an observable.
function figure(file, setting, observable, column,    k) {
    if (!(file in rows)) load(file)
    for (k = 1; k <= rows[file]; k++)
        if (setting_name(file, k) == setting && (observable == "" || value(file, k, "observable") == observable))
            return value(file, k, column)
    fault(file ": no setting " setting " " observable)
}

# How many times faster than LMGC90's settings.
function speed(name, kind, setting,    file) {
    file = study(name, kind, "settings")
    return figure(file, "lmgc90", "", "seconds") / figure(file, setting, "", "seconds")
}

# Mean of the speeds over the scenes, of their logarithms.
function mean_speed(kind, setting,    s, sum) {
    for (s = 1; s <= compared; s++) sum += log(speed(scene_compared[s], kind, setting))
    return exp(sum / compared)
}

# Observables with a bias beyond a limit without the part of chance, and an interval of 95 % that does not contain zero.
function excesses(kind, setting, limit,    s, k, file, text, found) {
    for (s = 1; s <= compared; s++) {
        file = study(scene_compared[s], kind, "bias"); found = ""
        for (k = 1; k <= 3; k++)
            if (figure(file, setting, observable[k], "low") * figure(file, setting, observable[k], "high") > 0 \
                && figure(file, setting, observable[k], "without_chance") > limit) found = found (found == "" ? "" : ", ") symbol[k]
        if (found != "") text = text (text == "" ? "" : "; ") found " of `" scene_compared[s] "`"
    }
    return text == "" ? "none" : text
}

# Biases of the presets with their standard errors, of the seeds on which nothing was chosen.
function presets(    s, k, i, file, row) {
    print "| scene | run | seconds | LMGC90's over it | Z | ν | pressure |\n|---|---|---|---|---|---|---|"
    for (s = 1; s <= compared; s++) for (k = 1; k <= 3; k++) {
        file = study(scene_compared[s], "validated", "bias"); row = ""
        for (i = 1; i <= 3; i++) row = row sprintf(" %+.2f ± %.2f %% |", 100 * figure(file, compared_run[k], observable[i], "bias"), \
            100 * figure(file, compared_run[k], observable[i], "standard_error"))
        printf "| %s | %s | %.2f | %.1f |%s\n", k == 1 ? scene_compared[s] : "", compared_run[k] == "lmgc90" ? "LMGC90's" : compared_run[k], \
            figure(study(scene_compared[s], "validated", "settings"), compared_run[k], "", "seconds"), speed(scene_compared[s], "validated", compared_run[k]), row
    }
}

# Requirements of the presets, and the results: of the seeds on which nothing was chosen.
function verdict(    k, s, x, low, high, limit) {
    for (k = 1; k <= 2; k++) {
        low = 1e9; high = 0; limit = k == 1 ? 0.03 : 0.01
        for (s = 1; s <= compared; s++) {
            x = speed(scene_compared[s], "validated", compared_run[k])
            if (x < low) low = x
            if (x > high) high = x
        }
        printf "- `%s`: %.1f to %.1f times as fast as LMGC90's parameters, mean %.1f (target: %s). Biases beyond\n  %g %%: %s.\n", \
            compared_run[k], low, high, mean_speed("validated", compared_run[k]), k == 1 ? "10" : "3", 100 * limit, excesses("validated", compared_run[k], limit)
    }
    printf "- LMGC90's parameters: biases beyond 1 %%: %s.\n", excesses("validated", "lmgc90", 0.01)
}

# Mean of the seconds of a candidate over the scenes, of their logarithms.
function mean_seconds(setting,    s, sum) {
    for (s = 1; s <= compared; s++) sum += log(figure(study(scene_compared[s], "chosen", "settings"), setting, "", "seconds"))
    return exp(sum / compared)
}

# The candidates, fastest first.
function candidates(    file, k, n, name, order, i, j, x) {
    file = study("collapse", "chosen", "settings"); load(file)
    for (k = 1; k <= rows[file]; k++) {
        name = setting_name(file, k)
        if (name != "reference") order[++n] = name
    }
    for (i = 2; i <= n; i++) for (j = i; j > 1 && mean_seconds(order[j]) < mean_seconds(order[j - 1]); j--) {
        x = order[j]; order[j] = order[j - 1]; order[j - 1] = x
    }
    print "| candidate | time | biases beyond 3 % | beyond 1 % |\n|---|---|---|---|"
    for (i = 1; i <= n; i++)
        printf "| `%s` | %.2f | %s | %s |\n", order[i], mean_seconds(order[i]) / mean_seconds(order[1]), \
            excesses("chosen", order[i], 0.03), excesses("chosen", order[i], 0.01)
}

# Result of a case, a target error of an observable in a scene, in the table of the biases.
function delivered(s, name, k, column) { return figure(study(scene_targeted[s], "targets", "bias"), name, observable[k], column) }

function seconds(s, setting) { return figure(study(scene_targeted[s], "targets", "settings"), setting, "", "seconds") }

# Whether the 95 % interval of the bias is beyond the target on one side.
function shown_beyond(s, setting, k, target,    low, high) {
    low = delivered(s, setting, k, "low"); high = delivered(s, setting, k, "high")
    return low > target || high < -target
}

# Seconds of the fastest setting chosen by hand whose bias without chance is below the target; 0 if there is none.
function fastest_by_hand(s, k, target,    i, x, least) {
    for (i = 1; i <= by_hand; i++) {
        x = seconds(s, setting_by_hand[i])
        if (delivered(s, setting_by_hand[i], k, "without_chance") <= target && (!least || x < least)) least = x
    }
    return least
}

# Lines of a list with at most 118 columns.
function listed(text,    words, n, i, line) {
    n = split(text, words, " "); line = "-"
    for (i = 1; i <= n; i++) {
        if (length(line " " words[i]) > 118) { print line; line = " " }
        line = line " " words[i]
    }
    print line
}

function median(x, n,    i, j, y) {
    for (i = 2; i <= n; i++) for (j = i; j > 1 && x[j] < x[j - 1]; j--) { y = x[j]; x[j] = x[j - 1]; x[j - 1] = y }
    return n % 2 ? x[(n + 1) / 2] : (x[n / 2] + x[n / 2 + 1]) / 2
}

# Biases with target errors, those beyond the target in bold.
function targets(    s, k, t, row, setting, mark) {
    print "| scene | Z 3 % | Z 1 % | ν 3 % | ν 1 % | pressure 3 % | pressure 1 % |\n|---|---|---|---|---|---|---|"
    for (s = 1; s <= targeted; s++) {
        row = ""
        for (k = 1; k <= 3; k++) for (t = 1; t <= 2; t++) {
            setting = target_name[k] "-" target_percent[t]
            if (delivered(s, setting, k, "bias") == "") { row = row " - |"; continue }
            mark = delivered(s, setting, k, "without_chance") > target_percent[t] / 100 ? "**" : ""
            row = row sprintf(" %s%+.2f ± %.2f%s |", mark, 100 * delivered(s, setting, k, "bias"), \
                100 * delivered(s, setting, k, "standard_error"), mark)
        }
        printf "| %s |%s\n", scene_targeted[s], row
    }
}

# Counts of the cases of the scenes from `first` to `last`.
function target_counts(title, first, last,    s, k, t, setting, name, target, x, best, cases, below, near, free, chance, beyond, shown, \
        compared_cases, ratios, twice, none, largest, largest_name) {
    for (s = first; s <= last; s++) for (k = 1; k <= 3; k++) for (t = 1; t <= 2; t++) {
        setting = target_name[k] "-" target_percent[t]; target = target_percent[t] / 100
        x = delivered(s, setting, k, "without_chance")
        if (x == "") continue
        name = symbol[k] " " target_percent[t] " % of `" scene_targeted[s] "`"
        cases++
        if (x <= target) below++
        else {
            beyond = beyond (beyond == "" ? "" : "; ") name ", " percent(x)
            if (shown_beyond(s, setting, k, target)) shown = shown (shown == "" ? "" : "; ") name
        }
        if (x >= target / 3 && x <= target) near++
        if (delivered(s, "coarsest", k, "without_chance") < target / 3) free++
        if (delivered(s, setting, k, "standard_error") > target) chance++
        best = fastest_by_hand(s, k, target)
        if (!best) { none++; continue }
        x = seconds(s, setting) / best; ratios[++compared_cases] = x
        if (x <= 2) twice++
        if (x > largest) { largest = x; largest_name = name }
    }
    listed(sprintf("%s: %d of %d errors are below their target, %d are not more than 3 times below it. With the coarsest options, too, %d of %d are below a third of the target. The standard error alone exceeds the target in %d.", \
        title, below, cases, near, free, cases, chance))
    listed(sprintf("Beyond the target: %s. With a 95 %% interval that is beyond the target: %s.", beyond == "" ? "none" : beyond, shown == "" ? "none" : shown))
    listed(sprintf("Run time over that of the fastest setting chosen by hand whose error is below the target: %.1f (median), at most 2 in %d of %d cases, at most %.1f (%s). In %d cases none of these settings is below it.", \
        median(ratios, compared_cases), twice, compared_cases, largest, largest_name, none))
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

# Largest bias of a preset over the scenes, without chance.
function largest(setting, name,    s, x, most) {
    for (s = 1; s <= compared; s++) {
        x = figure(study(scene_compared[s], "validated", "bias"), setting, name, "without_chance")
        if (x > most) most = x
    }
    return percent(most)
}

# Help texts of the presets: of `draft` and `standard` from the biases, of the others, which are compared with `standard` in study.ron, from
# its errors.
function statements(    k, s, name, x, low, high, cost, file, text) {
    for (k = 1; k <= 4; k++) {
        name = preset[k]; low = 1e9; high = 0
        for (s = 1; s <= (k > 2 ? scenes : compared); s++) {
            if (k > 2) {
                file = tables(s) "accuracy.csv"
                x = value(file, row_of(file, "standard"), "seconds") / value(file, row_of(file, name), "seconds")
            } else x = speed(scene_compared[s], "validated", name) / speed(scene_compared[s], "validated", "standard")
            if (x < low) low = x
            if (x > high) high = x
        }
        if (name == "standard") cost = ""
        else if (high < 1) cost = sprintf("%d to %d times slower than standard; ", 1 / high + 0.5, 1 / low + 0.5)
        else cost = sprintf("%.1f to %.1f times as fast as standard; ", low, high)
        if (k <= 2) text = sprintf("biases in eight scenes, without chance: solid fraction up to %s, pressure %s, neighbours per grain %s", \
            largest(name, "nu"), largest(name, "pressure"), largest(name, "Z"))
        else if (name == "reference") text = "the others are compared with it"
        else text = sprintf("errors: solid fraction %s, pressure %s, neighbours per grain %s; in a heap, mostly by chance: %s, %s, %s", \
            range(name, "nu"), range(name, "pressure"), range(name, "Z"), \
            by_chance(name, "nu"), by_chance(name, "pressure"), by_chance(name, "Z"))
        printf "%s%s", cost, text > ("formats/src/accuracy/" name ".txt")
    }
}

# An error that does not depend on the option has no price.
function followed(order, r2, digit,    size) {
    size = order < 0 ? -order : order
    if (size < 0.1) return "no effect"
    return sprintf("%.2f (r² %.2f)", order, r2) (r2 >= 0.8 ? sprintf(", %.2g times", digit) : ", -")
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

# Cost and error of another method instead of the standard one; `folder`: of the tables of one realisation of a scene.
function instead(scene, folder, name, option,    file, run, base) {
    file = "examples/accuracy-study/figures/" folder "/accuracy.csv"
    if (!(file in rows)) load(file)
    run = row_of(file, name); base = row_of(file, "dt-1")
    printf "- `%s` in `%s`: %.2f times the seconds; error of the early positions %.1e in place of %.1e.\n", option, scene, \
        value(file, run, "seconds") / value(file, base, "seconds"), value(file, run, "positions_early"), value(file, base, "positions_early")
}

function honesty(    s, file, k, x, all, good, small, large, sum, sums, lone, honest) {
    for (s = 1; s <= scenes; s++) realised(s)
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
    # Estimates are those of the first four; of `cloud`, which has no contacts, what self-gravity does.
    scenes = split("collapse rest spin heap cloud", scene, " ") - 1
    split("draft standard fine reference", preset, " ")
    compared = split("collapse rest spin impact bonds heap drum triaxial", scene_compared, " ")
    split("draft standard lmgc90", compared_run, " ")
    split("Z nu pressure", observable, " "); split("Z ν pressure", symbol, " ")
    # The seeds of study.ron.
    realisations = split("5 12 13", seed, " "); split("2 12 13", heap_seed, " ")
    # Of the last two nothing was known when the choice was made.
    targeted = split("collapse rest spin impact bonds heap drum triaxial rubble shear merger column whirl mill", scene_targeted, " ")
    by_hand = split("coarsest a16-t1e-1 b16-t5e-2 b4-t5e-2 draft standard", setting_by_hand, " ")
    split("z nu pressure", target_name, " "); split("3 1", target_percent, " ")
    groups = split("dt tol penetration_tol max_sweeps theta adaptive alert gravity_error gravity_refresh gravity_order gravity_opening", group, " ")
}

/^<!-- [a-z]+: begin -->$/ && $2 ~ /^(presets|candidates|knobs|early|honesty|figures|targets):$/ && (section == "" || $2 == section ":") {
    print; print ""
    if ($2 == "presets:") { presets(); print ""; verdict(); statements() }
    else if ($2 == "knobs:") knobs("", scenes, groups - 2)
    else if ($2 == "early:") {
        knobs("_early", scenes + 1, groups); print ""
        instead("heap", "heap-" heap_seed[1], "fast", "narrow_phase: fast"); instead("cloud", "cloud", "direct", "gravity: direct")
    }
    else if ($2 == "candidates:") candidates()
    else if ($2 == "honesty:") honesty()
    else if ($2 == "targets:") {
        targets(); print ""
        target_counts("Eight scenes", 1, 8); target_counts("Held-out scenes", 9, 10)
        target_counts("Later scenes", 11, targeted)
    }
    else figures()
    print ""; skipping = 1
    next
}
/^<!-- [a-z]+: end -->$/ { skipping = 0 }
!skipping { print }

END { if (failed) exit 1 }
