# `make study` of an example whose scene is one cloud: the same with other numbers of grains, coefficients of friction and
# cohesions between two grains (N), a folder a run. The Makefile that includes this says
#
#   NUMBERS, FRICTIONS              every combination is a run without cohesion
#   COHESIONS, COHESIVE_FRICTIONS   and every one of these with NUMBERS a run with it; may be empty
#   LARGER, LARGER_FRICTIONS        more numbers and their coefficients of friction, without cohesion; may be empty
#   SHOWN                           the friction of the runs whose course is shown for every number, without cohesion
#   FROM, END, REST                 means are taken between the first two; what still moves then is brought to rest until REST, s
#   STILL, STILL_TIME               numbers whose frictionless run goes on until true rest, for so long, s; may be empty
#   BESIDE, BESIDE_NAME, OWN_NAME   runs of another study whose pressures are shown beside these, and what the two are called; may be empty

EMPTY :=
COMMA := ,
SPACE := $(EMPTY) $(EMPTY)
listed = $(subst $(SPACE),$(COMMA),$(strip $(1)))
reversed = $(if $(1),$(call reversed,$(wordlist 2,$(words $(1)),$(1))) $(firstword $(1)))
# Of study/N250-mu0.4-f1000: number, friction, cohesion, group.
part = $(patsubst $(2)%,%,$(filter $(2)%,$(subst -, ,$(notdir $(1)))))
group = mu$(call part,$(1),mu)-f$(call part,$(1),f)
law = $(if $(filter 0,$(2)),IQS_CLB(friction: $(1)),IQS_WET_DS_CLB(cohesion: $(2), range: 0.1, dynamic_friction: $(1), static_friction: $(1)))

SMALL := $(foreach mu,$(FRICTIONS),$(NUMBERS:%=study/N%-mu$(mu)-f0)) \
	$(foreach f,$(COHESIONS),$(foreach mu,$(COHESIVE_FRICTIONS),$(NUMBERS:%=study/N%-mu$(mu)-f$(f))))
LARGE := $(foreach mu,$(LARGER_FRICTIONS),$(LARGER:%=study/N%-mu$(mu)-f0))
RUNS := $(SMALL) $(LARGE)
STILLED := $(strip $(foreach number,$(STILL),$(if $(filter study/N$(number)-mu0-f0,$(RUNS)),study/still-N$(number))))
LARGEST := $(lastword $(NUMBERS))
BY_NUMBER := $(filter %-mu$(SHOWN)-f0,$(RUNS))
BY_LAW := $(filter study/N$(LARGEST)-%,$(RUNS))
TIMES := Ec_mean,Z_all,nu_sphere,pressure_sphere

ifneq ($(filter study,$(MAKECMDGOALS)),)
# With `make -j` what takes longest begins first: many grains, and much friction.
FIRST := $(call reversed,$(LARGE)) $(call reversed,$(filter %-mu$(lastword $(FRICTIONS))-f0,$(SMALL)))
CASES := $(FIRST) $(filter-out $(FIRST),$(SMALL)) $(STILLED)
POST_FLAGS := --no-vtk
shown = $(CD_BIN)/cd-post $(1) -o study/figures$(2) $(REPORTED)
by_group = --groups $(call listed,$(foreach run,$(RUNS),$(call group,$(run))))
FIGURES = set -e; \
	$(call shown,study $(RUNS) --from $(FROM) --until $(END) $(by_group)); \
	$(call shown,study $(RUNS) $(by_group),/rest); \
	$(if $(STILLED),$(call shown,study $(STILLED),/still);) \
	$(if $(BESIDE),$(call shown,study $(RUNS) $(BESIDE) --groups $(call listed,$(RUNS:%=$(OWN_NAME)) $(BESIDE:%=$(BESIDE_NAME))),/beside);) \
	$(if $(BY_NUMBER),$(call shown,compare $(BY_NUMBER) --columns $(TIMES),/by-number);) \
	$(if $(BY_LAW),$(call shown,compare $(BY_LAW) --columns $(TIMES),/by-law))
endif
$(foreach run,$(RUNS),$(eval INPUT_$(run) := scene.ron))
$(foreach run,$(RUNS),$(eval PRE_$(run) = $$(CD_BIN)/cd-pre scene.ron -o $(run) --set grains.1.number=$(call part,$(run),N) \
	--set 'laws.1.kind=$(call law,$(call part,$(run),mu),$(call part,$(run),f))' --set compute.end_time=$(REST) \
	--set 'compute.events=[(time: $(END), action: SetQuench(0.01))]'))
# Close to critical damping of the whole, and solved so finely that what carries no force is told from what does.
$(foreach run,$(STILLED),$(eval INPUT_$(run) := study/N$(run:study/still-N%=%)-mu0-f0/OUTBOX/.done))
$(foreach run,$(STILLED),$(eval PRE_$(run) = $$(CD_BIN)/cd-pre from-outbox study/N$(run:study/still-N%=%)-mu0-f0 $(run) \
	--set 'compute=(dt: 4.0, end_time: $(STILL_TIME), tol: 1.0e-6, self_gravity: true, quench: 0.004, output_every: 1000)'))

MADE := study
include $(dir $(lastword $(MAKEFILE_LIST)))example.mk

.PHONY: study
study: all
