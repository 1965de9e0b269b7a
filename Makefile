# Every target creates the environment if it does not exist yet.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STUDY ?= rows
CASE ?= studies/three-rows.toml
READY := $(VENV)/.ready
TABLE := firmware/generated/mode_table.bin
SIX_TABLE := firmware/generated/six_table.bin
JOBS ?=
SHARD ?= 1/1
STORE ?=
UNTIL ?=
COUNT ?=
SEED ?=
FOLDERS ?= solvers geometry pipeline/records pipeline/case firmware/core
EVERY := fast,firmware,client,dev,tables,uff,docs,release
EXTRAS ?= $(EVERY)
.DEFAULT_GOAL := help
# Two workers; one that has finished takes tests from the end of the other's list, so that a file's tests stay together.
SLOW = $(BIN)/python -m pytest -q -n 2 --dist worksteal --durations-path tests/durations.json $(if $(STORE),--store-durations)
unexport PYTHONDONTWRITEBYTECODE  # compile sources once, not once per process
.PHONY: help setup study test lint slow durations test-all fuzz mutants check-gap firmware image-single image-six flash flash-six bench docs release licences clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

setup: $(READY)  ## create the environment only

# Every package by version and hash; with fewer extras by version only, as pip takes none next to an editable project.
# uv installs in a fifth of pip's time; where it cannot be had, pip does.
$(READY): pyproject.toml constraints.txt
	@pip="$(BIN)/python -m pip --disable-pip-version-check"; \
	"$(PYTHON)" -m venv $(VENV) && \
	sed -n '/^uv==/,/[^\\]$$/p' constraints.txt > $(VENV)/uv.txt && \
	if $$pip install --quiet --require-hashes --requirement $(VENV)/uv.txt; then pip="$(BIN)/uv pip"; fi && \
	export VIRTUAL_ENV=$(VENV) && \
	if [ '$(EXTRAS)' = '$(EVERY)' ]; then \
	    $$pip install --quiet --require-hashes --no-deps --requirement constraints.txt && \
	    $$pip install --quiet --no-deps --no-build-isolation --editable .; \
	else \
	    sed -n 's/^\([^ #]*==[^ ;]*\).*/\1/p' constraints.txt > $(VENV)/versions.txt && \
	    $$pip install --quiet --constraint $(VENV)/versions.txt --editable '.[$(EXTRAS)]'; \
	fi
	@touch $@

study: $(READY)  ## run the main study, or STUDY=name, and print the path of its report
	@$(BIN)/antinode run $(STUDY) --explorer $(if $(JOBS),--jobs $(JOBS))

test: $(READY)  ## run every test not marked slow, with firmware and the band-gap check
	@$(BIN)/antinode check-gap --quiet
	@$(BIN)/python -m pytest -q -n 2 --dist worksteal

lint: $(READY)  ## check style and types
	@$(BIN)/ruff check . && $(BIN)/ruff format --quiet --check . && $(BIN)/mypy

slow: $(READY)  ## run the slow proofs, or a share of them: SHARD=k/n; STORE=1 stores their durations
	@SLOW_UNTIL=$(UNTIL) $(SLOW) -m slow --splits $(notdir $(SHARD)) --group $(patsubst %/,%,$(dir $(SHARD)))

durations: $(READY)  ## list the longest slow proofs, from tests/durations.json
	@$(BIN)/slowest-tests --durations-path tests/durations.json --count 40

test-all: test slow  ## run all tests

fuzz: $(READY)  ## read COUNT damaged files and replies, solve COUNT/500 drawn plates; SEED=n repeats a run
	@$(BIN)/python -m tests.fuzz $(if $(COUNT),--count $(COUNT)) $(if $(SEED),--seed $(SEED))

mutants: $(READY)  ## plant COUNT small faults in each of FOLDERS, and count those that the tests notice
	@$(BIN)/python -m studies.mutants --folders $(FOLDERS) $(if $(COUNT),--count $(COUNT)) $(if $(SEED),--seed $(SEED))

check-gap: $(READY)  ## recompute the reference cell's band gap
	@$(BIN)/antinode check-gap

$(TABLE): $(READY) $(CASE)
	@mkdir -p $(@D)
	@$(BIN)/antinode export table $(CASE) -o $@

$(SIX_TABLE): $(READY)
	@mkdir -p $(@D)
	@$(BIN)/python -m pipeline.board.six_channels $@ --unmeasured

firmware: image-single image-six  ## build both STM32F446 images from exported mode tables

image-single: $(TABLE)
	@$(BIN)/python -m firmware.build --table $(TABLE)

image-six: $(SIX_TABLE)
	@$(BIN)/python -m firmware.build --table $(SIX_TABLE) --variant six

flash: image-single  ## write the one-mode image to a board (OpenOCD, pyOCD, probe-rs or st-flash)
	@$(BIN)/python -m firmware.flash single

flash-six: image-six  ## write the six-channel image to a board
	@$(BIN)/python -m firmware.flash six

bench: $(READY)  ## measure error over run time
	@$(BIN)/antinode run accuracy --jobs 1
	@$(BIN)/antinode run extremes --jobs 1
	@$(BIN)/python -m studies.benchmarks

docs: $(READY)  ## build the documentation site, with new pictures if sources changed (minutes)
	@$(BIN)/python docs/site/make_site.py

release: docs firmware  ## put sdist, wheel, site, firmware, SBOM and checksums into dist/; publish nothing
	@rm -rf dist
	@SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct 2>/dev/null || echo 0) $(BIN)/python -m build --no-isolation --outdir dist .
	@$(BIN)/cyclonedx-py environment --of JSON --output-reproducible --pyproject pyproject.toml -o dist/antinode.cdx.json $(BIN)/python
	@tar --sort=name --owner=0 --group=0 --numeric-owner -C build/docs -czf dist/antinode-site.tar.gz site
	@cd firmware/build && tar --sort=name --owner=0 --group=0 --numeric-owner -czf ../../dist/antinode-firmware.tar.gz \
		$(foreach image,antinode antinode-six,$(image).elf $(image).bin $(image).map $(image).svd)
	@cd dist && sha256sum * > SHA256SUMS && cat SHA256SUMS

licences: $(READY)  ## write docs/licences.md from the metadata of the installed packages
	@$(BIN)/python -m studies.licences

clean:  ## remove everything that the other targets created, but never results/reference
	@rm -rf firmware/build firmware/generated .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache build dist *.egg-info
	@find results -mindepth 1 -maxdepth 1 ! -name reference ! -name README.md -exec rm -rf {} +
	@rm -rf $(VENV)
