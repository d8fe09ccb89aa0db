# `make help`: the first comment of each file in RON, which is what an example computes, and the variables and goals with the
# comments above them, from the Makefile and the shared rules. A comment that begins with two marks belongs to the variable
# (VAR ?= value) or the goal (goal:) below it; of a variable that several files set the first counts, as in make.
.PHONY: help
## Lists variables and targets.
help:
	@awk 'FNR == 1 { text = "" } \
	    FILENAME ~ /ron$$/ { if (FNR == 1) { sub("^// *", ""); printf "  %-28s %s\n", FILENAME, $$0 }; next } \
	    /^## / { text = text (text == "" ? "" : " ") substr($$0, 4); next } \
	    text != "" && match($$0, /^[A-Za-z_][A-Za-z_ -]*(\?=|:)/) { \
	        name = $$0; sub(/ *\?= */, "=", name); sub(/[:$$].*/, "", name); key = name; sub(/=.*/, "=", key); \
	        if (name ~ /=.* /) { sub(/=/, "=\047", name); name = name "\047" } \
	        if (!seen[key]++) printf "  make %-23s%s%s\n", name, (length(name) > 22 ? sprintf("\n%31s", "") : " "), text } \
	    { text = "" }' $(wildcard *.ron) $(MAKEFILE_LIST)
