# Targets of the project; `make` lists them.

CARGO ?= cargo
CARGO_TARGET_DIR ?= target
TARGET := $(abspath $(CARGO_TARGET_DIR))
BIN := $(TARGET)/release
SIDE_BY_SIDE = $(MAKE) --no-print-directory --jobs=$(shell getconf _NPROCESSORS_ONLN) SOLVE_FLAGS="--threads 1"
# The programs as the tests have built them: tests give some libraries more features, and without them all is built again.
TESTED = $(CARGO) test --workspace $(FEATURES) --no-run --quiet
# `make test MPI=1` tests programs with MPI, and includes runs of several processes.
FEATURES = $(if $(MPI),--features cd-solve/mpi)
MDBOOK_VERSION := 0.5.4
MDBOOK := $(TARGET)/mdbook-$(MDBOOK_VERSION)/bin/mdbook
MANUAL := $(TARGET)/manual
EXTREMES := extremes envelope limits thousand_periods a_minute a_wall_stands

.PHONY: help build demo paper paper-pages accuracy-study trade extremes performance performance-page test torture fuzz soak ranks python aarch64 vtk browser golden dist lint fmt doc docs check clean
.DEFAULT_GOAL := help

help: ## lists the targets
	@awk -F ' ## ' '/^[a-z0-9-]+:.* ## / { sub(/:.*/, "", $$1); printf "  make %-16s %s\n", $$1, $$2 }' Makefile

build: ## cd-pre, cd-solve and cd-post, in release mode, in target/release
	$(CARGO) build --release --bins

demo: ## runs examples/accretion: the collapse of a thousand grains
	$(CARGO) build --release --bin cd-pre --bin cd-solve
	$(MAKE) --no-print-directory -C examples/accretion CD_BIN=$(BIN) STAGES="pre solve"
	$(MAKE) --no-print-directory build
	$(MAKE) --no-print-directory -C examples/accretion CD_BIN=$(BIN)
	@echo "Results, in examples/accretion:"
	@echo "  POSTPRO/series.csv     a row a snapshot; docs/reference/observables/series.md names the columns"
	@echo "  POSTPRO/*.svg          energy, coordination, solid fraction, pressure, semi-axes against time"
	@echo "  POSTPRO/aggregate.svg  the aggregate at the end"
	@echo "  DISPLAY/view.py        in ParaView: paraview --script=examples/accretion/DISPLAY/view.py"
	@echo "  OUTBOX/steps.csv       cost and error of every step"

paper: build ## runs the studies, one run on each core, and writes docs/explanation/paper
	$(SIDE_BY_SIDE) $(STUDIES:%=study-of-%) CD_BIN=$(BIN) STAGES="pre solve post"
	$(SIDE_BY_SIDE) $(STUDIES:%=study-of-%) CD_BIN=$(BIN)
	$(MAKE) --no-print-directory paper-pages

PAPER_PAGES ?= $(patsubst docs/paper/%.md.in,%,$(wildcard docs/paper/*.md.in))
paper-pages: ## writes docs/explanation/paper from the runs that are there, or the pages PAPER_PAGES of it
	for page in $(PAPER_PAGES); do \
	    LC_ALL=C awk -f docs/paper/paper.awk docs/paper/$$page.md.in > docs/paper/$$page.part \
	        && mv docs/paper/$$page.part docs/explanation/paper/$$page.md || exit 1; \
	done

# The longest studies start first. Figures, which may show runs of two studies, come after all runs.
STUDIES := accretion-polyhedra spin-up accretion regolith triaxial shape-model
STUDY = $(MAKE) --no-print-directory -C examples/$*
# Seconds of a core that each study has taken since `make clean`, for the page.
TIMED = ; status=$$?; times >> docs/paper/$*.times; exit $$status
.PHONY: $(STUDIES:%=study-of-%)
study-of-accretion study-of-accretion-polyhedra study-of-regolith: study-of-%:
	+$(STUDY) study $(TIMED)
study-of-triaxial study-of-shape-model: study-of-%:
	+$(STUDY) $(TIMED)
study-of-spin-up: study-of-%:
	+$(STUDY) fluid $(TIMED)
	+$(STUDY) $(TIMED)

accuracy-study: build ## runs examples/accuracy-study, in one and a half hours, and writes its figures into docs/explanation/accuracy.md
	$(MAKE) --no-print-directory -C examples/accuracy-study CD_BIN=$(BIN)
	$(SIDE_BY_SIDE) -C examples/accuracy-study presets CD_BIN=$(BIN)
	$(SIDE_BY_SIDE) -C examples/accuracy-study targets CD_BIN=$(BIN)
	awk -f docs/accuracy/accuracy.awk docs/explanation/accuracy.md > docs/explanation/accuracy.md.part
	mv docs/explanation/accuracy.md.part docs/explanation/accuracy.md

# Name of earlier versions.
trade: accuracy-study

extremes: ## runs scenes at the limits of the parameters, with 1 and 2 threads, with and without optimisation, and writes docs/explanation/limits.md
	for profile in dev release; do for threads in 1 2; do \
	    CD_TESTS_LONG=1 CD_TESTS_THREADS=$$threads $(CARGO) test --profile $$profile --package cd-solve --test cases -- --nocapture $(EXTREMES) \
	        > docs/limits-$$profile-$$threads.log 2> docs/limits.err \
	        || { grep -h panicked -A3 docs/limits-$$profile-$$threads.log docs/limits.err; exit 1; }; \
	done; done
	LC_ALL=C awk -f docs/limits/limits.awk docs/limits-*.log docs/limits/limits.md.in > docs/explanation/limits.md.part
	mv docs/explanation/limits.md.part docs/explanation/limits.md
	rm docs/limits-*.log docs/limits.err

performance: build ## runs the quick benchmarks on this machine and draws docs/explanation/performance.md for it; MACHINE: its name
	$(CARGO) build --release --package cd-solve --example gravity --example fc3d
	set -e; export MACHINE=$$(bench/machine.sh) CD_BIN=$(BIN) CARGO_TARGET_DIR=$(TARGET); \
	for command in run gravity size fc3d; do bench/$$command.sh; done
	$(MAKE) --no-print-directory performance-page MACHINE=$$(bench/machine.sh)

performance-page: ## draws docs/explanation/performance.md from bench/results, for its machine or for MACHINE
	LC_ALL=C awk $(MACHINE:%=-v machine=%) -f bench/performance.awk docs/explanation/performance.md > docs/explanation/performance.md.part
	mv docs/explanation/performance.md.part docs/explanation/performance.md

test: ## all tests; with CD_REQUIRE_VTK=1, CD_REQUIRE_CHROMIUM=1, CD_REQUIRE_VALGRIND=1, CD_REQUIRE_QEMU=1 and CD_REQUIRE_TORTURE=1 missing tools are errors
	$(CARGO) test --workspace $(FEATURES) --no-fail-fast
	$(MAKE) --no-print-directory vtk
	$(MAKE) --no-print-directory browser

torture: ## kills the programs and lets disks fail: TORTURE: numbers of trials and seed, as docs/development/torture.md says
	$(CARGO) run --release --package cd-tests --example torture -- $(TORTURE)

fuzz: ## reads INPUTS damaged files with each reader, without a nightly Rust; FUZZ: further options, see docs/development/fuzzing.md
	$(CARGO) run --release --package cd-tests --example fuzz -- --inputs $(or $(INPUTS),10000000) $(FUZZ)

soak: ## runs a small scene for STEPS (1e7) steps, and for 1e5 with a snapshot each: memory and time per step must not grow
	$(CARGO) run --release --package cd-tests --example soak -- --steps $(or $(STEPS),10000000)
	$(CARGO) run --release --package cd-tests --example soak -- --steps 100000 --snapshots 100000

# With all packages as in `make test`: only those with the feature are built again.
ranks: MPI = 1
ranks: ## runs small scenes on several processes of MPI; with CD_REQUIRE_MPI=1 a missing mpirun is an error
	$(CARGO) test --workspace $(FEATURES) --test cases -- ranks

# The programs are those of `make build`, with symbols; with CD_BIN those of another folder.
python: ## installs the Python package in target/python-venv and runs its tests and mypy there
	python3 -m venv $(TARGET)/python-venv
	CARGO_PROFILE_RELEASE_STRIP=none $(TARGET)/python-venv/bin/pip install --quiet . mypy
	$(TARGET)/python-venv/bin/python -m unittest discover --start-directory python/tests
	$(TARGET)/python-venv/bin/mypy python/cd_toolchain python/tests

aarch64: ## on Debian x86-64: compares results of Linux aarch64, under QEMU, with those of this machine; installs what it needs
	.ci/aarch64

vtk: ## reads the ParaView files of two small cases back with VTK
	$(TESTED)
	TARGET=$(TARGET) tests/vtk_readback.sh

browser: ## opens the report of a small case in Chromium, without a screen
	$(TESTED)
	TARGET=$(TARGET) tests/report_in_browser.sh

golden: ## regenerates the expected files of tests/golden, of all scenes or of SCENE=name, and prints the largest changes
	$(CARGO) run --quiet --package cd-tests --example golden -- $(SCENE)

dist: ## the archive of a release for this machine, in target/dist: programs, manual pages, completions, licences
	.ci/archive

lint: ## formatting, clippy without warnings
	$(CARGO) fmt --all --check
	$(CARGO) clippy --workspace --all-targets -- -D warnings

fmt: ## formats the code
	$(CARGO) fmt --all

doc: ## documentation of the code, without warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps

# Files from which pages are generated lie next to the pages, but are not part of the site.
docs: $(MDBOOK) ## the manual as a site, in target/manual; warnings and broken links are errors
	rm -rf $(MANUAL)
	$(MDBOOK) build docs --dest-dir $(MANUAL) 2> $(MANUAL).log || { cat $(MANUAL).log; exit 1; }
	@! grep -E 'WARN|ERROR' $(MANUAL).log
	rm -r $(addprefix $(MANUAL)/,accuracy joss limits paper book.toml site/check.py site/links.py site/style.css)
	python3 docs/site/check.py $(MANUAL)

$(MDBOOK):
	$(CARGO) install mdbook --version $(MDBOOK_VERSION) --locked --quiet --profile dev --no-default-features --features search \
	    --root $(TARGET)/mdbook-$(MDBOOK_VERSION) --target-dir $(TARGET)/mdbook-build
	rm -r $(TARGET)/mdbook-build

check: lint doc docs test ## lint, doc, docs and test

clean: ## removes build files and the results of the examples
	$(CARGO) clean
	rm -f docs/paper/*.times
	for example in examples/*/Makefile; do $(MAKE) --no-print-directory -C "$${example%/Makefile}" clean; done
