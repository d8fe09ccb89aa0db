# The rules that all examples share:
#
#   study.ron -cd-pre study-> CASE/scene.ron -cd-pre-> CASE/DATBOX -cd-solve-> CASE/OUTBOX -cd-post-> CASE/POSTPRO, CASE/DISPLAY
#
# Without a study an example has one case, its own folder. The Makefile of one with a study says STUDY := study.ron before it
# includes this file. `cd-pre study` writes the cases, and study.mk with their names and the order in which they depend on each other.
#
# A stage is made again when its input or its program is newer than its FOLDER/.done. That file is removed before the program
# starts and written after it has ended well, so that a stage that was refused or killed is not done. DATBOX is made again when
# PRE_FLAGS change; SOLVE_FLAGS and POST_FLAGS are not watched.

EXAMPLES := $(patsubst %/,%,$(dir $(lastword $(MAKEFILE_LIST))))
TOP := $(abspath $(EXAMPLES)/..)
## Folder of the programs.
CD_BIN ?= $(or $(CARGO_TARGET_DIR),$(TOP)/target)/release
## Flags of cd-pre for scenes, such as "--set grains.1.number=500".
PRE_FLAGS ?=
## Flags of cd-solve, such as "--threads 1".
SOLVE_FLAGS ?=
## Flags of cd-post.
POST_FLAGS ?=
## Stages that are made.
STAGES ?= pre solve post figures
$(if $(word 2,$(CD_BIN)),$(error CD_BIN: $(CD_BIN): expected a path without blanks, which make takes for several))

.DEFAULT_GOAL := all
.PHONY: all pre solve post figures resume clean always
.SECONDEXPANSION:

# `clean` and `help` alone need no cases.
ifneq ($(and $(STUDY),$(filter-out clean help,$(or $(MAKECMDGOALS),all))),)
include $(STUDY:.ron=.mk)
endif
## Folders of the cases that are made, as of study.ron; default: all.
CASES ?= .
FIGURES ?= @set -e; $(foreach case,$(CASES),awk -f $(EXAMPLES)/figures.awk $(case)/OUTBOX/steps.csv $(case)/POSTPRO/series.csv;)
include $(EXAMPLES)/help.mk

# A stage of all cases, in the order in which `make -j` begins them: ORDER, or that of CASES.
# Make drops the `./` of the case `.`, and then no pattern fits.
stage = $(patsubst %,%/$(1)/.done,$(patsubst .,$(CURDIR),$(or $(ORDER),$(CASES))))
## The stages that are not up to date, then the figures.
all: $(STAGES)
## The cases up to DATBOX.
pre: $(call stage,DATBOX)
## Up to OUTBOX.
solve: $(call stage,OUTBOX)
## Up to POSTPRO and DISPLAY.
post: $(call stage,POSTPRO)
figures: post
	$(FIGURES)
## Goes on from the last snapshots after an interruption or, with other SOLVE_FLAGS, to a later end.
resume: all
## Removes all results.
clean:
	rm -rf DATBOX OUTBOX POSTPRO DISPLAY TIMER.csv ERRORS.csv .pre-flags $(MADE) \
	    $(wildcard $(patsubst %.ron,%.mk,$(wildcard *.ron)) $(patsubst %.ron,%.csv,$(wildcard *.ron)))

# The folder of a case, and the case that one goes on from. Exit status 1: done, with something reported.
case = $(patsubst $(CURDIR),.,$*)
from = $(patsubst %/OUTBOX/.done,%,$(filter %/OUTBOX/.done,$^))
REPORTED = || test $$? -eq 1
resumed := $(filter resume,$(MAKECMDGOALS))
# With flags what has ended goes on, too.
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

# Holds PRE_FLAGS; newer than what was made with others.
.pre-flags: $(if $(subst x$(shell cat .pre-flags 2> /dev/null)x,,x$(strip $(PRE_FLAGS))x),always)
	@printf '%s\n' '$(subst ','\'',$(strip $(PRE_FLAGS)))' > $@

ifneq ($(STUDY),)
# Scenes that are as before keep their time.
$(STUDY:.ron=.mk): $(STUDY) $(CD_BIN)/cd-pre
	$(CD_BIN)/cd-pre study $(STUDY)
%/scene.ron:
	$(CD_BIN)/cd-pre study $(STUDY)
%/changes.ron:
	$(CD_BIN)/cd-pre study $(STUDY)
endif

# Programs that are not there; `make build` at the top brings them up to date.
$(addprefix $(CD_BIN)/cd-,pre solve post):
	$(MAKE) --no-print-directory -C $(TOP) build

# The last state of each case in depth, and none that an earlier run has left.
last_states = for case in $(1); do rm -rf $$case/POSTPRO/state-*; $(CD_BIN)/cd-post state $$case $(REPORTED); done
# Words with commas between them, as options take lists.
EMPTY :=
COMMA := ,
SPACE := $(EMPTY) $(EMPTY)
listed = $(subst $(SPACE),$(COMMA),$(strip $(1)))
