# Every target makes the environment it needs and reuses it the next time.
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
EXTRAS ?= fast,firmware,client,dev,tables,uff,docs,release
.DEFAULT_GOAL := help
# Two workers; one that has finished takes tests from the end of the other's list, so that a file's tests stay together.
SLOW = $(BIN)/python -m pytest -q -n 2 --dist worksteal --durations-path tests/durations.json $(if $(STORE),--store-durations)
unexport PYTHONDONTWRITEBYTECODE  # sources are compiled once, not once a process
.PHONY: help setup study test slow durations test-all check-gap firmware image-single image-six flash flash-six bench docs release licences clean

help:  ## what the targets do
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

setup: $(READY)  ## the environment alone

$(READY): pyproject.toml constraints.txt
	@if command -v uv >/dev/null 2>&1; then \
	    uv venv --quiet --allow-existing --python "$(PYTHON)" $(VENV) && \
	    VIRTUAL_ENV=$(VENV) uv pip install --quiet --constraint constraints.txt --editable '.[$(EXTRAS)]'; \
	else \
	    "$(PYTHON)" -m venv $(VENV) && \
	    $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[$(EXTRAS)]'; \
	fi
	@touch $@

study: $(READY)  ## the main job, or STUDY=name; ends with where the report is
	@$(BIN)/antinode run $(STUDY) --explorer $(if $(JOBS),--jobs $(JOBS))

test: $(READY)  ## every test not marked slow, firmware and the band-gap check included
	@$(BIN)/ruff check .
	@$(BIN)/mypy & types=$$!; \
	$(BIN)/antinode check-gap --quiet && $(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder; \
	tests=$$?; wait $$types && exit $$tests

slow: $(READY)  ## the slow proofs, or a share of them: SHARD=k/n; STORE=1 stores their durations
	@$(SLOW) -m slow --splits $(notdir $(SHARD)) --group $(patsubst %/,%,$(dir $(SHARD)))

durations: $(READY)  ## the slow proofs that took longest, from tests/durations.json
	@$(BIN)/slowest-tests --durations-path tests/durations.json --count 40

test-all: test slow  ## every test

check-gap: $(READY)  ## recompute the reference cell's band gap
	@$(BIN)/antinode check-gap

$(TABLE): $(READY) $(CASE)
	@mkdir -p $(@D)
	@$(BIN)/antinode export table $(CASE) -o $@

$(SIX_TABLE): $(READY)
	@mkdir -p $(@D)
	@$(BIN)/python -m pipeline.board.six_channels $@ --unmeasured

firmware: image-single image-six  ## both STM32F446 images from exported mode tables

image-single: $(TABLE)
	@$(BIN)/python -m firmware.build --table $(TABLE)

image-six: $(SIX_TABLE)
	@$(BIN)/python -m firmware.build --table $(SIX_TABLE) --variant six

flash: image-single  ## put the one-mode image onto a board (OpenOCD, pyOCD, probe-rs or st-flash)
	@$(BIN)/python -m firmware.flash single

flash-six: image-six  ## the same with the six-channel image
	@$(BIN)/python -m firmware.flash six

bench: $(READY)  ## error against run time
	@$(BIN)/antinode run accuracy --jobs 1
	@$(BIN)/antinode run extremes --jobs 1
	@$(BIN)/python -m studies.benchmarks

docs: $(READY)  ## the documentation site, its pictures made anew where sources changed (minutes)
	@$(BIN)/python docs/site/make_site.py

release: docs firmware  ## sdist, wheel, site, firmware, SBOM and checksums into dist/; nothing is published
	@rm -rf dist
	@SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct 2>/dev/null || echo 0) $(BIN)/python -m build --no-isolation --outdir dist .
	@$(BIN)/cyclonedx-py environment --of JSON --output-reproducible --pyproject pyproject.toml -o dist/antinode.cdx.json $(BIN)/python
	@tar --sort=name --owner=0 --group=0 --numeric-owner -C build/docs -czf dist/antinode-site.tar.gz site
	@cd firmware/build && tar --sort=name --owner=0 --group=0 --numeric-owner -czf ../../dist/antinode-firmware.tar.gz \
		$(foreach image,antinode antinode-six,$(image).elf $(image).bin $(image).map $(image).svd)
	@cd dist && sha256sum * > SHA256SUMS && cat SHA256SUMS

licences: $(READY)  ## docs/licences.md from the installed packages' own words
	@$(BIN)/python -m studies.licences

clean:  ## what the others made, never results/reference
	@rm -rf firmware/build firmware/generated .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache build dist *.egg-info
	@find results -mindepth 1 -maxdepth 1 ! -name reference ! -name README.md -exec rm -rf {} +
	@rm -rf $(VENV)
