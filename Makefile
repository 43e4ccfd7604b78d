# Every command of the project. PYTHON chooses the interpreter, VENV the environment, ARGS goes to dronecombat.
PYTHON ?= python3
VENV ?= .venv
ARGS ?=
RUN ?=
SCALE ?= laptop
PEERS_VENV ?= .venv-peers
RUNS ?= $(wildcard runs/ippo runs/sippo)

BIN := $(VENV)/bin
# $(call install,ENVIRONMENT,WHAT): one line; what pip says goes to a log, and where it fails its last lines are shown.
install = echo "installing packages into $(1); what pip says is in $(1)/install.log"; \
	$(1)/bin/python -m pip --disable-pip-version-check install -c constraints.txt $(2) >> $(1)/install.log 2>&1 || \
	{ tail -n 5 $(1)/install.log >&2; echo "error: pip failed; all of what it said is in $(1)/install.log" >&2; exit 1; }

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help train-ippo train-sippo tournament report reproduce replay play notebooks docs test test-quick test-long test-tour test-slow check format bench bench-scaling bench-peers clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

train-ippo: $(VENV)/.runtime ## train attacker and defender with IPPO (ARGS="--train.seed 1" adds flags)
	$(BIN)/dronecombat train --preset duel --name ippo $(ARGS)

train-sippo: $(VENV)/.runtime ## the same with self-play: the defender also meets past attackers
	$(BIN)/dronecombat train --preset duel --selfplay.probability 0.2 --name sippo $(ARGS)

tournament: $(VENV)/.runtime ## all checkpoints of runs/ippo and runs/sippo, those that are there, and the scripted pilots
	@test -n "$(RUNS)" || { echo "error: neither runs/ippo nor runs/sippo is there: make train-ippo, make train-sippo, or RUNS=\"runs/a runs/b\"" >&2; exit 2; }
	$(BIN)/dronecombat tournament $(RUNS) scripted:all $(ARGS)

report: $(VENV)/.runtime ## draw a tournament (ARGS=its folder or name)
	$(BIN)/dronecombat report $(ARGS)

reproduce: $(VENV)/.runtime ## the paper's experiment, whole or the rest of it (SCALE=smoke, laptop, gpu or paper)
	$(BIN)/dronecombat reproduce --scale $(SCALE) $(ARGS)

replay: $(VENV)/.runtime ## a page that replays the last run's fights, in a browser if there is one (RUN=name, ARGS="--evolution")
	$(BIN)/dronecombat replay $(RUN) --open $(ARGS)

play: $(VENV)/.runtime ## a page on which you fly against the last run, in a browser if there is one (RUN=name, ARGS="--side defender")
	$(BIN)/dronecombat play $(RUN) --open $(ARGS)

notebooks: $(VENV)/.dev ## write experiments/notebooks/*.ipynb from their percent scripts
	$(BIN)/python experiments/notebooks/build.py

docs: $(VENV)/.docs ## the documentation site in build/docs; a warning or a broken link is an error
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo "written: build/docs/index.html"

# A file of tests goes to one of two processes, and shares there what it compiles.
test: $(VENV)/.dev ## the fast tests, in two processes (ARGS="-n 0": in one)
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(ARGS)

# Rooms whose tests compile little: for the loop of editing and testing.
QUICK := tests/config tests/files tests/analysis tests/policies tests/combat tests/test_architecture.py \
	tests/learn/test_ppo.py tests/learn/test_networks.py tests/learn/test_normalize.py \
	tests/selfplay/test_samplers.py tests/cli/test_commands.py tests/cli/test_run_commands.py tests/cli/test_program.py
test-quick: $(VENV)/.dev ## the tests of the rooms that compile little, about a minute
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(QUICK) $(ARGS)

test-long: $(VENV)/.dev ## trainings, tournaments and drones that are compiled for one test
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m long $(ARGS)

test-tour: $(VENV)/.dev ## pages in a browser, notebooks, examples, a short training
	$(BIN)/python -m pytest -n 2 -m tour $(ARGS)

test-slow: $(VENV)/.dev ## the tests that take minutes
	$(BIN)/python -m pytest -m slow $(ARGS)

check: $(VENV)/.dev ## ruff, pyright and the import linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

format: $(VENV)/.dev ## let ruff format and repair
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(VENV)/.runtime ## measure throughput beside the ceilings of this machine, about 5 minutes (ARGS="--rounds 3")
	$(BIN)/python -m benchmarks.throughput $(ARGS)

bench-scaling: $(VENV)/.runtime ## how cost grows with environments, seeds, past players and entrants, about 20 minutes
	$(BIN)/python -m benchmarks.scaling $(ARGS)

bench-peers: $(PEERS_VENV)/.peers ## measure other learners on the same game beside ours (in an environment of its own)
	$(PEERS_VENV)/bin/python -m benchmarks.peers.compare $(ARGS)

clean: ## remove the environment and every cache; runs/ stays
	rm -rf $(VENV) $(PEERS_VENV) viewer/node_modules .cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis build dist
	find dronecombat_jax tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamps are newer than what they were made from, or the environment is made anew.
$(VENV)/.runtime: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; (3, 11) <= sys.version_info < (3, 14) or sys.exit("error: $(PYTHON) is Python %d.%d; 3.11, 3.12 (recommended) or 3.13 is needed: make PYTHON=python3.12 ..." % sys.version_info[:2])'
	@echo "making $(VENV) with $(PYTHON); the packages are large, the first time takes minutes"
	@rm -f $(VENV)/.runtime $(VENV)/.dev $(VENV)/.docs
	@$(PYTHON) -m venv --clear $(VENV)
	@$(call install,$(VENV),-e .)
	@touch $@

$(VENV)/.dev: $(VENV)/.runtime
	@$(call install,$(VENV),-e '.[dev]')
	@touch $@

$(VENV)/.docs: $(VENV)/.runtime
	@$(call install,$(VENV),-e '.[docs]')
	@touch $@

$(PEERS_VENV)/.peers: pyproject.toml constraints.txt benchmarks/peers/requirements.txt
	@echo "making $(PEERS_VENV) with $(PYTHON); the packages are large, the first time takes minutes"
	@$(PYTHON) -m venv --clear $(PEERS_VENV)
	@$(call install,$(PEERS_VENV),-r benchmarks/peers/requirements.txt -e .)
	@touch $@
