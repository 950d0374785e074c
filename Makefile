# Each of these targets first installs the dependencies into .venv:
#   make all     run the workflow on config/config.yaml
#   make test    lint, run the tests that a change is likely to break
#   make check   lint, run the tests that check which jobs are planned
# Also: make test-slow (whole runs, hostile files), make test-full (all tests; PART=1/4: a quarter of them),
# make lint, make docs, make figures, make release, make clean.
PYTHON ?= python3
JOBS ?= 2
RUN ?= default
BIN := .venv/bin
# Hundreds of processes import the same modules: each would compile them anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: all check test test-slow test-full lint docs figures wasm release clean

all: .venv/installed
	$(BIN)/snakemake -j$(JOBS) all

test: lint
	$(BIN)/pytest -n $(JOBS) --dist loadfile --durations 20

test-slow: .venv/installed
	$(BIN)/pytest -n $(JOBS) --maxschedchunk 1 --durations 20 -m "slow and not full"

check: lint
	$(BIN)/pytest -n $(JOBS) --dist loadfile tests/plan

test-full: lint
	$(BIN)/pytest -m "" -n $(JOBS) --dist worksteal --durations 15 $(if $(PART),--part $(PART))

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run --Werror $$(find docs tests workflow \( -name '*.[ch]' -o -name '*.cpp' \) ! -name pandis.h)
	$(BIN)/snakefmt --check workflow/Snakefile rules
	$(BIN)/snakemake --lint --configfile config/fast.yaml

# write the generated files: the schema, pandis.h, environments, tables and API pages
docs: .venv/installed
	PYTHONPATH=workflow $(BIN)/python docs/tools/generate.py

# copy the last run's figures to docs/figures (RUN=sphere: those of config/sphere.yaml), then do the same as docs
figures: .venv/installed
	PYTHONPATH=workflow $(BIN)/python docs/tools/generate.py figures $(RUN)

.venv/installed: constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --requirement constraints.txt
	$(BIN)/python -m pip install --no-deps mujoco-warp==4.0.0  # it needs only MuJoCo's core
	printf '#!/bin/sh\nPYTHONPATH="%s/workflow$${PYTHONPATH:+:$$PYTHONPATH}" exec "%s/$(BIN)/python" -m pandis "$$@"\n' "$(CURDIR)" "$(CURDIR)" > $(BIN)/pandis
	chmod +x $(BIN)/pandis
	touch $@

# compile pandis.wasm, which web pages run: needs Debian's clang and lld; commit the result
wasm: .venv/installed
	PYTHONPATH=workflow $(BIN)/python docs/tools/wasm.py

# build wheel, source distribution and pandis.h in dist/, check them, run README's programs with them
release: .venv/installed
	$(BIN)/python docs/tools/release.py

clean:
	rm -rf .venv .pytest_cache .ruff_cache dist build
