# Functions for the scripts of the examples that make figures of several cases. The Makefile gives a script the folder of the
# programs in CD_BIN and the cases as arguments; the script begins with `. ../cases.sh`.
all_cases="$*"

# cases PATTERN: the cases that the pattern of the shell fits, in the order of the study.
cases() {
    for case in $all_cases; do
        # shellcheck disable=SC2254
        case $case in $1) echo "$case" ;; esac
    done
}

# names EXPRESSION CASE...: names of cases as a list with commas: each case as the expression of sed changes it.
names() {
    expression=$1
    shift
    printf '%s\n' "$@" | sed "$expression" | paste -s -d , -
}

# option CASE NAME: the number in COMPUTE.RON of a case that the name stands before, such as end_time; the first of several.
option() {
    sed -n "s/^\(.*[ (]\)\{0,1\}$2: *\(Some(\)\{0,1\}\([-+.0-9eE]\{1,\}\).*/\3/p" "$1/DATBOX/COMPUTE.RON" | head -n 1
}

# calculation EXPRESSION: its value, by awk.
calculation() {
    awk "BEGIN { print $1 }"
}

# cd_post ARGUMENT...: runs cd-post. Its exit status 1 is a success: done, with something reported.
cd_post() {
    "$CD_BIN/cd-post" "$@" || test $? -eq 1
}

# last_states CASE...: analyses the last state of each case, and removes the states of earlier runs.
last_states() {
    for case; do
        rm -rf "$case"/POSTPRO/state-*
        cd_post state "$case"
    done
}
