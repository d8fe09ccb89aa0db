# The rules that all examples share:
#
#   scene.ron -cd-pre-> DATBOX/ -cd-solve-> OUTBOX/ -cd-post-> POSTPRO/, DISPLAY/
#
#   make             the stages that are not up to date, then the figures of the end
#   make -n          what that would do
#   make solve       up to a stage: pre, solve, post
#   make resume      goes on from the last snapshot, after an interruption or for a later end, where
#                    `make` would begin anew; then as `make`
#   make clean
#
#   make SOLVE_FLAGS="--threads 1"      flags of the programs: PRE_FLAGS, SOLVE_FLAGS, POST_FLAGS
#   make CD_BIN=DIR                     where the programs are
#
# A stage is made again when its input or its program is newer than its FOLDER/.done. That file is
# taken away before the program starts and comes back when it has ended well, so that a stage that
# was refused or killed is not done. DATBOX/.done holds the command of cd-pre: another one, as by a variable of the
# example, makes the case again. SOLVE_FLAGS and POST_FLAGS are not watched.
#
# An example with several cases lists their folders in CASES; they have the scene of the example, if no rule for
# CASE/scene.ron makes another. What `make clean` takes away beside the files of the cases is listed in MADE. A case that is
# made of something else, such as the end of another, has PRE_CASE, the command for its DATBOX, and INPUT_CASE, what
# that reads. PRE_FLAGS belong to scenes, and a case made from another has none.

EXAMPLES := $(patsubst %/,%,$(dir $(lastword $(MAKEFILE_LIST))))
TOP := $(abspath $(EXAMPLES)/..)
CD_BIN ?= $(or $(CARGO_TARGET_DIR),$(TOP)/target)/release
STAGES ?= pre solve post figures
CASES ?= .
$(if $(word 2,$(CD_BIN)),$(error CD_BIN: $(CD_BIN): expected a path without blanks, which make takes for several))
FIGURES ?= @set -e; $(foreach case,$(CASES),awk -f $(EXAMPLES)/figures.awk $(case)/OUTBOX/steps.csv $(case)/POSTPRO/series.csv;)

.PHONY: all pre solve post figures resume clean
.DEFAULT_GOAL := all

all: $(STAGES)
pre: $(CASES:%=%/DATBOX/.done)
solve: $(CASES:%=%/OUTBOX/.done)
post: $(CASES:%=%/POSTPRO/.done)

figures: post
	$(FIGURES)

# Exit status 1: done, with something reported.
REPORTED = || test $$? -eq 1
# The last state of each case in depth, and none that an earlier run has left.
last_states = for case in $(1); do rm -rf $$case/POSTPRO/state-*; $(CD_BIN)/cd-post state $$case $(REPORTED); done
# The command for the DATBOX of a case; the same as text for a shell, wherever the program is; and whether DATBOX comes of another.
pre_of = $(or $(PRE_$(1)),$(CD_BIN)/cd-pre $(1)/scene.ron -o $(1))
pre = $(strip $(pre_of) $(if $(findstring cd-pre from-outbox,$(pre_of)),,$(PRE_FLAGS)))
text = '$(subst ','\'',$(subst $(CD_BIN)/,,$(pre)))'
made_by = $(shell cat $(1)/DATBOX/.done 2> /dev/null)
other = $(subst x$(made_by)x,,x$(shell printf '%s' $(text))x)

# What is interrupted goes on, and with flags what has ended, too.
resumed := $(filter resume,$(MAKECMDGOALS))
onward := $(and $(resumed),$(filter command environment,$(origin SOLVE_FLAGS)))

define rules
$(1)/DATBOX/.done: $(or $(INPUT_$(1)),$(1)/scene.ron) $(CD_BIN)/cd-pre $(if $(call other,$(1)),always)
	@rm -f $$@
	$$(call pre,$(1)) $$(REPORTED)
	@printf '%s\n' $$(call text,$(1)) > $$@

$(1)/OUTBOX/.done: $(1)/DATBOX/.done $(wildcard $(1)/DATBOX/*) $(CD_BIN)/cd-solve $(if $(onward),always)
	@rm -f $$@
	$(CD_BIN)/cd-solve $(if $(resumed),--resume,--force) $(SOLVE_FLAGS) $(1) $$(REPORTED)
	@touch $$@

$(1)/POSTPRO/.done: $(1)/OUTBOX/.done $(wildcard $(1)/OUTBOX/*.npz) $(CD_BIN)/cd-post
	@rm -f $$@
	$(CD_BIN)/cd-post $(POST_FLAGS) $(1) $$(REPORTED)
	@touch $$@
endef
$(foreach case,$(CASES),$(eval $(call rules,$(case))))
.PHONY: always

%/scene.ron: scene.ron
	@mkdir -p $(@D)
	cp $< $@

resume: all

# Files found above that are gone by now, as in `make clean all`.
$(foreach case,$(CASES),$(wildcard $(case)/DATBOX/* $(case)/OUTBOX/*.npz)): ;

# Programs that are not there; `make build` at the top brings them up to date.
$(CD_BIN)/cd-%:
	$(MAKE) --no-print-directory -C $(TOP) build

clean:
	rm -rf $(foreach case,$(CASES),$(addprefix $(case)/,DATBOX OUTBOX POSTPRO DISPLAY TIMER.csv ERRORS.csv)) $(MADE)
