# A user needs two commands, `make reproduce` and `make test`; both set up .venv by themselves. `make help` lists the rest.

VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/reproduce
RUNS ?= runs
PYTHON ?=

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help setup setup-dev reproduce serve wheel screenshots answers pictures test test-slow test-long test-realtime check bench bench-gpu peers campaign docs reference lock clean

help: ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(VENV)/.runtime ## make .venv with what Sinew needs (PYTHON=... picks the interpreter)

reproduce: $(VENV)/.runtime ## the paper's campaign on the twin: table, figures and report in out/reproduce (OUT=...)
	$(BIN)/sinew reproduce --out $(OUT)

serve: $(VENV)/.serve ## the dashboard with an emulated bench, in the browser (RUNS=... the folder of its runs)
	$(BIN)/sinew serve --emulate --runs $(RUNS)

answers: reproduce ## the paper's open questions asked of that campaign: out/reproduce/answers.html
	$(BIN)/sinew report $(OUT) --answers

wheel: $(VENV)/.dev ## sdist and wheel in dist/, tried in an empty environment of each of PYTHONS="python3.11 ..." (some minutes each)
	$(BIN)/python tools/try_wheel.py $(PYTHONS)

screenshots: $(VENV)/.dev ## every page and state of the dashboard as pictures of README and docs, from Chromium (some minutes)
	$(BIN)/python -m tools.take_screenshots docs/pictures/dashboard

# Two workers on two cores: a second thread of BLAS only waits for its first. XLA compiles a third faster without its
# fusion emitters; no number of `make reproduce` moved by 1e-9. Files of tests run in their order, for by number of tests
# the longest would come last and alone.
test test-slow test-long: export OPENBLAS_NUM_THREADS ?= 1
test test-slow test-long: export XLA_FLAGS ?= --xla_cpu_use_fusion_emitters=false
TESTS := $(BIN)/python -m pytest -q -n auto --dist loadfile --no-loadscope-reorder

test: $(VENV)/.dev ## the fast tests
	$(TESTS) --maxprocesses 4 -m "not slow and not hardware"

test-slow: $(VENV)/.dev ## the long proofs: coverage of intervals, the whole campaign, executed tutorials
	$(TESTS) --maxprocesses 2 --durations=30 -m "slow and not long and not realtime and not hardware"

test-long: $(VENV)/.dev ## the longest proofs: intervals counted over whole campaigns, long tutorials
	$(TESTS) --maxprocesses 2 --durations=10 -m "long and not hardware"

test-realtime: $(VENV)/.dev ## proofs that keep time with an emulated bench; nothing else should run beside them
	$(BIN)/python -m pytest -q -m "slow and realtime and not hardware"

check: $(VENV)/.dev ## lint, format, strict types, the import law, links in the docs, no hosts in the tree, the budget, spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/check_links.py
	$(BIN)/python tools/check_hosts.py
	$(BIN)/python tools/check_budget.py
	$(BIN)/codespell

bench: $(VENV)/.dev ## one table of work beside its peer: solve_ivp, MuJoCo, dynamixel-sdk, pyFRF, PySINDy, pyHarm-os, SoRoMoX
	-@test -e .venv-peers/.peers || $(MAKE) --no-print-directory peers
	$(BIN)/python -m benchmarks

bench-gpu: $(VENV)/.dev ## batches of designs and of the posterior on a GPU beside the CPU, where JAX finds one
	$(BIN)/python -m benchmarks gpu

peers: $(VENV)/.runtime ## make .venv-peers with what `make bench` compares with and .venv cannot hold, and a master of the bus in Rust
	@sh tools/peers.sh

campaign: $(VENV)/.dev ## 500 runs of the emulated bench in which something goes wrong: fault x outcome (about 15 min)
	$(BIN)/python -m campaigns.faults --runs 500 --seed 0 --workers 2 --out out/campaigns/faults.json
	$(BIN)/python -m campaigns.faults --hostile --runs 300 --seed 0 --workers 2 --out out/campaigns/hostile.json

docs: $(VENV)/.dev ## the documentation as HTML in docs/_build; every example of the gallery is run anew
	rm -rf docs/gallery
	$(BIN)/python -m sphinx -q -W --keep-going -n -b html docs docs/_build
	@echo "docs/_build/index.html"

pictures: reproduce ## the pictures of README and docs, from the figures of `make reproduce` and of the tutorial's own commands
	$(BIN)/sinew report $(OUT) --film sweep --pretension-mm 4
	$(BIN)/python tools/copy_pictures.py $(OUT)/figures docs/pictures
	$(BIN)/python tools/pages.py docs/pictures
	$(BIN)/sinew modes paper --force --out docs/pictures/space.png

reference: $(VENV)/.runtime ## write the generated pages of docs/reference anew
	$(BIN)/python tools/write_reference.py

lock: ## write requirements.txt and requirements-dev.txt anew from pyproject.toml (needs uv; see docs/how-to)
	sh tools/lock.sh

clean: ## remove what the other targets made, except .venv
	rm -rf out build dist docs/_build docs/gallery .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find src tests tools benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

setup-dev: $(VENV)/.dev

$(VENV)/.runtime: requirements.txt pyproject.toml tools/setup.sh
	@PYTHON="$(PYTHON)" sh tools/setup.sh runtime

$(VENV)/.serve: $(VENV)/.runtime requirements-serve.txt
	@sh tools/setup.sh serve

$(VENV)/.dev: $(VENV)/.runtime requirements-dev.txt
	@sh tools/setup.sh dev
