# `make study` of an example whose scene is one cloud: the same with other numbers of grains, coefficients of friction and
# cohesions between two grains (N), a folder a run. The Makefile that includes this says NUMBERS, FRICTIONS, COHESIONS, the
# times FROM and END between which means are taken, and REST, until when what still moves is brought to rest, s.

EMPTY :=
COMMA := ,
SPACE := $(EMPTY) $(EMPTY)
listed = $(subst $(SPACE),$(COMMA),$(strip $(1)))
# Of study/N250-mu0.4-f1000: number, friction, cohesion, group.
part = $(patsubst $(2)%,%,$(filter $(2)%,$(subst -, ,$(notdir $(1)))))
group = mu$(call part,$(1),mu)-f$(call part,$(1),f)
law = $(if $(filter 0,$(2)),IQS_CLB(friction: $(1)),IQS_WET_DS_CLB(cohesion: $(2), range: 0.1, dynamic_friction: $(1), static_friction: $(1)))

RUNS := $(foreach f,$(COHESIONS),$(foreach mu,$(FRICTIONS),$(NUMBERS:%=study/N%-mu$(mu)-f$(f))))
LARGEST := $(lastword $(NUMBERS))
BY_NUMBER := $(NUMBERS:%=study/N%-mu$(lastword $(filter-out 1,$(FRICTIONS)))-f0)
BY_LAW := $(filter study/N$(LARGEST)-%,$(RUNS))
TIMES := Ec_mean,Z,nu,pressure

ifneq ($(filter study,$(MAKECMDGOALS)),)
CASES := $(RUNS)
POST_FLAGS := --no-vtk
FIGURES = $(CD_BIN)/cd-post study $(RUNS) -o study/figures --from $(FROM) --until $(END) --groups $(call listed,$(foreach run,$(RUNS),$(call group,$(run)))); \
	$(CD_BIN)/cd-post study $(RUNS) -o study/figures/rest --groups $(call listed,$(foreach run,$(RUNS),$(call group,$(run)))); \
	$(if $(word 2,$(BY_NUMBER)),$(CD_BIN)/cd-post compare $(BY_NUMBER) -o study/figures/by-number --columns $(TIMES);) \
	$(if $(word 2,$(BY_LAW)),$(CD_BIN)/cd-post compare $(BY_LAW) -o study/figures/by-law --columns $(TIMES))
endif
$(foreach run,$(RUNS),$(eval INPUT_$(run) := scene.ron))
$(foreach run,$(RUNS),$(eval PRE_$(run) = $$(CD_BIN)/cd-pre scene.ron -o $(run) --set grains.1.number=$(call part,$(run),N) \
	--set 'laws.1.kind=$(call law,$(call part,$(run),mu),$(call part,$(run),f))' --set compute.end_time=$(REST) \
	--set 'compute.events=[(time: $(END), action: SetQuench(0.01))]'))

include $(dir $(lastword $(MAKEFILE_LIST)))example.mk

.PHONY: study remove-study
study: all
clean: remove-study
remove-study:
	rm -rf study
