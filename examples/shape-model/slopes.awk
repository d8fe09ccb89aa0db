# Semi-axes and slopes at the end of each case, from its series.csv and the surface.csv of its last state; with -v csv=FILE the
# same as a table.
BEGIN {
	FS = ","; if (csv) print "case,a,b,c,nu,mean_slope,slope_of_nine_tenths,share_above_30" > csv
	printf "%-8s %6s %6s %6s %6s %8s %8s %10s\n", "", "a", "b", "c", "nu", "slope", "90 %", "above 30°"
}
FNR == 1 {
	finish(); split("", column); for (i = 1; i <= NF; i++) column[$i] = i
	split(FILENAME, path, "/"); surface = FILENAME ~ /surface/
	next
}
surface { if ($column["slope"] != "") { weight = cos($column["latitude"] * atan2(0, -1) / 180); all += weight; steep += weight * ($column["slope"] > 30); sum += weight * $column["slope"]; slopes[n++] = $column["slope"] } ; next }
{ a = $column["a"]; b = $column["b"]; c = $column["c"]; nu = $column["nu"] }
END { finish() }
function finish(    i, j, t) {
	if (!n) return
	for (i = 1; i < n; i++) { t = slopes[i]; for (j = i - 1; j >= 0 && slopes[j] > t; j--) slopes[j + 1] = slopes[j]; slopes[j + 1] = t }
	printf "%-8s %6.1f %6.1f %6.1f %6.3f %8.1f %8.1f %9.0f %%\n", path[1], a, b, c, nu, sum / all, slopes[int(0.9 * n)], 100 * steep / all
	if (csv) printf "%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", path[1], a, b, c, nu, sum / all, slopes[int(0.9 * n)], steep / all > csv
	n = all = steep = sum = 0
}
