# Figures of `make study` of a cloud that falls together. The Makefile that includes this says
#
#   FROM, END               means are taken between these, s
#   SHOWN                   friction of the runs whose course is shown for every number of grains, without cohesion
#   LARGEST                 number of grains of the runs that are shown for every law
#   OTHERS, OTHERS_NAME, OWN_NAME   runs of another study whose pressures are shown with these, and labels of the two; may be empty

ifneq ($(filter study,$(MAKECMDGOALS)),)
STUDY := study.ron
## Flags of cd-post in the study.
POST_FLAGS ?= --no-vtk
# With `make -j` what takes longest begins first: many grains, and much friction.
ORDER = $(call reverse_order,$(RUNS)) $(STILL_RUNS)
reverse_order = $(if $(1),$(call reverse_order,$(wordlist 2,$(words $(1)),$(1))) $(firstword $(1)))
RUNS = $(filter study/N%,$(CASES))
STILL_RUNS = $(filter study/still-%,$(CASES))
BY_NUMBER = $(filter %-mu$(SHOWN)-f0,$(RUNS))
BY_LAW = $(filter study/N$(LARGEST)-%,$(RUNS))
TIMES := Ec_mean,Z_all,nu_sphere,pressure_sphere
# mu0.4-f0 of study/N250-mu0.4-f0.
law_name = $(subst $(SPACE),-,$(wordlist 2,3,$(subst -, ,$(1))))
law_groups = --groups $(call comma_list,$(foreach run,$(RUNS),$(call law_name,$(run))))
write_figures = $(CD_BIN)/cd-post $(1) -o study/figures$(2) $(REPORTED)
FIGURES = set -e; \
	$(call write_figures,study $(RUNS) --from $(FROM) --until $(END) $(law_groups)); \
	$(call write_figures,study $(RUNS) $(law_groups),/rest); \
	$(if $(STILL_RUNS),$(call write_figures,study $(STILL_RUNS),/still);) \
	$(if $(OTHERS),$(call write_figures,study $(RUNS) $(OTHERS) --groups $(call comma_list,$(RUNS:%=$(OWN_NAME)) $(OTHERS:%=$(OTHERS_NAME))),/compared);) \
	$(if $(BY_NUMBER),$(call write_figures,compare $(BY_NUMBER) --columns $(TIMES),/by-number);) \
	$(if $(BY_LAW),$(call write_figures,compare $(BY_LAW) --columns $(TIMES),/by-law))
endif
MADE := study
include $(dir $(lastword $(MAKEFILE_LIST)))../rules.mk

.PHONY: study
## The cases of study.ron, with their figures.
study: all
