# The rules that all examples share:
#
#   study.ron -cd-pre study-> CASE/scene.ron -cd-pre-> CASE/DATBOX -cd-solve-> CASE/OUTBOX -cd-post-> CASE/POSTPRO, CASE/DISPLAY
#
# Without a study an example has one case, its own folder. The Makefile of one with a study says STUDY := study.ron before it
# includes this file. `cd-pre study` writes the cases, and study.mk with their names and the order in which they depend on each other.
#
# A stage is repeated if its input or its program is newer than its FOLDER/.done. That file is removed before the program
# starts and written after it has succeeded, so that a stage that failed or was killed is repeated. DATBOX is made again if
# PRE_FLAGS change; SOLVE_FLAGS and POST_FLAGS are not watched.

EXAMPLES := $(patsubst %/,%,$(dir $(lastword $(MAKEFILE_LIST))))
TOP := $(abspath $(EXAMPLES)/..)
BUILT := $(or $(CARGO_TARGET_DIR),$(TOP)/target)/release
ON_PATH := $(shell command -v cd-solve 2>/dev/null)
## Folder of the programs; default: those built here, else those on PATH.
CD_BIN ?= $(if $(wildcard $(BUILT)/cd-solve),$(BUILT),$(or $(patsubst %/,%,$(dir $(ON_PATH))),$(BUILT)))
## Flags of cd-pre for scenes, such as "--set grains.1.number=500".
PRE_FLAGS ?=
## Flags of "cd-pre study", such as "--replicates 5".
STUDY_FLAGS ?=
## Flags of cd-solve, such as "--threads 1".
SOLVE_FLAGS ?=
## Flags of cd-post.
POST_FLAGS ?=
## Stages to run.
STAGES ?= pre solve post figures
$(if $(word 2,$(CD_BIN)),$(error CD_BIN: $(CD_BIN): expected a path without blanks, which make takes for several))

.DEFAULT_GOAL := all
.PHONY: all pre solve post figures resume clean until always
.SECONDEXPANSION:

# `clean`, `help` and `until` alone need no cases.
ifneq ($(and $(STUDY),$(filter-out clean help until,$(or $(MAKECMDGOALS),all))),)
include $(STUDY:.ron=.mk)
endif
## Folders of the cases to run; default: all cases of the study, or the folder of the example.
CASES ?= $(if $(STUDY),,.)
FIGURES ?= @for case in $(CASES); do awk -f $(EXAMPLES)/figures.awk $$case/OUTBOX/steps.csv $$case/POSTPRO/series.csv || exit 1; done
include $(EXAMPLES)/help.mk

# An ORDER for studies whose last cases take longest.
LAST_CASE_FIRST = $(shell echo $(CASES) | awk '{ while (NF) print $$(NF--) }')

# A stage of all cases, in the order in which `make -j` begins them: ORDER, or that of CASES.
# Make drops the `./` of the case `.`, and then no pattern fits.
stage_files = $(patsubst %,%/$(1)/.done,$(patsubst .,$(CURDIR),$(or $(ORDER),$(CASES))))
## All stages that are not up to date, then the figures.
all: $(STAGES)
## All cases up to DATBOX.
pre: $(call stage_files,DATBOX)
## All cases up to OUTBOX.
solve: $(call stage_files,OUTBOX)
## All cases up to POSTPRO and DISPLAY.
post: $(call stage_files,POSTPRO)
## Figures of the example.
figures: post
	$(FIGURES)
## Continues from the last snapshots, after an interruption or, with other SOLVE_FLAGS, to a later end.
resume: all
## Removes all results.
clean:
	rm -rf DATBOX OUTBOX POSTPRO DISPLAY TIMER.csv ERRORS.csv .pre-flags $(MADE) \
	    $(wildcard $(patsubst %.ron,%.mk,$(wildcard *.ron)) $(patsubst %.ron,%.csv,$(wildcard *.ron)))

# Folder of a case, and the case that it continues. Exit status 1: done, with something reported.
case = $(patsubst $(CURDIR),.,$*)
from = $(patsubst %/OUTBOX/.done,%,$(filter %/OUTBOX/.done,$^))
REPORTED = || test $$? -eq 1
resumed := $(filter resume,$(MAKECMDGOALS))
# With flags, runs that have ended continue, too.
onward := $(and $(resumed),$(filter command environment,$(origin SOLVE_FLAGS)),always)

%/DATBOX/.done: %/scene.ron $(CD_BIN)/cd-pre .pre-flags
	@rm -f $@
	$(CD_BIN)/cd-pre $(case)/scene.ron -o $(case) $(PRE_FLAGS) $(REPORTED)
	@touch $@

%/DATBOX/.done: %/changes.ron $(CD_BIN)/cd-pre
	@rm -f $@
	$(CD_BIN)/cd-pre from-outbox $(from) $(case) --changes $(case)/changes.ron $(REPORTED)
	@touch $@

%/OUTBOX/.done: %/DATBOX/.done $$(wildcard $$*/DATBOX/*) $(CD_BIN)/cd-solve $(onward)
	@rm -f $@
	$(CD_BIN)/cd-solve $(if $(resumed),--resume,--force) $(SOLVE_FLAGS) $(case) $(REPORTED)
	@touch $@

%/POSTPRO/.done: %/OUTBOX/.done $$(wildcard $$*/OUTBOX/*.npz) $(CD_BIN)/cd-post
	@rm -f $@
	$(CD_BIN)/cd-post $(POST_FLAGS) $(case) $(REPORTED)
	@touch $@

# Contains PRE_FLAGS; newer than the files that were made with other flags.
.pre-flags: $(if $(subst x$(shell cat .pre-flags 2> /dev/null)x,,x$(strip $(PRE_FLAGS))x),always)
	@printf '%s\n' '$(subst ','\'',$(strip $(PRE_FLAGS)))' > $@

ifneq ($(STUDY),)
# Unchanged scenes keep their time.
$(STUDY:.ron=.mk): $(STUDY) $(CD_BIN)/cd-pre
	$(CD_BIN)/cd-pre study $(STUDY_FLAGS) $(STUDY)
%/scene.ron:
	$(CD_BIN)/cd-pre study $(STUDY_FLAGS) $(STUDY)
%/changes.ron:
	$(CD_BIN)/cd-pre study $(STUDY_FLAGS) $(STUDY)

## Quantity of `until`: a column of runs.csv of `cd-post study`.
QUANTITY ?= Z
## Half the width of the 95 % confidence interval of the mean at which `until` ends, over the mean.
ERROR ?= 0.01
## Largest number of seeds that `until` runs.
MAX_SEEDS ?= 50
## Runs more and more seeds of the study, until the mean of QUANTITY is known to ERROR in each parameter set.
until:
	@CD_BIN='$(CD_BIN)' MAKE='$(MAKE)' $(EXAMPLES)/until.sh $(STUDY) '$(QUANTITY)' '$(ERROR)' '$(MAX_SEEDS)'
else
until:
	@echo "until: $(CURDIR): has no study; expected an example with STUDY in its Makefile" >&2; exit 2
endif

# Missing programs; `make build` in the top folder brings them up to date.
$(addprefix $(CD_BIN)/cd-,pre solve post):
	$(MAKE) --no-print-directory -C $(TOP) build
