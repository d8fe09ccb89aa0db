# Function for the scripts that compare the settings of a study:
#
#     . ./compare.sh            after . ../cases.sh
#
# Reads: DATBOX, OUTBOX, POSTPRO, TIMER.csv and ERRORS.csv of cases, and the table of their study.
# Writes: figures/SCENE/KIND: bias.csv, settings.csv and the other tables of `cd-post accuracy-study`.

# compare TABLE SCENE KIND FROM CASE...: tables of these cases of the study; means are taken from the time FROM, s.
compare() {
    table=$1
    scene=$2
    kind=$3
    from=$4
    shift 4
    cd_post accuracy-study "$@" --parameters "$table" -o "figures/$scene/$kind" --from "$from" \
        --title "$scene, $kind: error against time"
}
