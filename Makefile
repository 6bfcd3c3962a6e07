# MarginGuard: `make demo` and `make test` are all that a fresh clone needs.

PYTHON ?= python3

venv    := .venv
python  := $(venv)/bin/python
run     := $(venv)/.installed-run
test    := $(venv)/.installed-test

case    := data/recorded_case
report  := out/demo

# Everything that decides what is installed. Our own Python files are not among it: they are used in place.
declared   := pyproject.toml constraints.txt tools/install.py
interfaces := $(shell find interfaces -type f -not -path '*/build/*' -not -path '*.egg-info/*' \
                -not -path '*/__pycache__/*')

# Left by the start-up hook of another environment's ROS wheels, it would keep ours from running.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE

.DELETE_ON_ERROR:
.PHONY: help demo test lint format doctor clean

help:
	@echo 'make demo    install, then replay $(case) into $(report)'
	@echo 'make test    install what tests need too, then run them'
	@echo 'make lint    ruff and mypy'
	@echo 'make format  let ruff rewrite the files'
	@echo 'make doctor  say what is there and what is missing'
	@echo 'make clean   remove the environment and all that was made'
	@echo 'PYTHON=...   the Python to make the environment with (3.11 to 3.13; now $(PYTHON))'

demo: $(run)
	@$(venv)/bin/marginguard replay $(case) --report $(report)
	@echo 'The report is $(report)/report.html'

# A test process that dies ends the run: pytest-xdist waits for ever for one that replaces it.
test: $(test)
	@$(python) -m pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart 0 $(PYTEST_ARGS)

lint: $(test)
	@$(python) -m ruff check
	@$(python) -m ruff format --check
	@$(python) -m mypy

format: $(test)
	@$(python) -m ruff check --fix
	@$(python) -m ruff format

doctor: $(run)
	@$(venv)/bin/marginguard doctor

clean:
	@rm -rf $(venv) out build interfaces/build .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -prune -exec rm -rf {} + -o -name '*.egg-info' -prune -exec rm -rf {} +

$(python):
	@command -v $(PYTHON) > /dev/null || { \
	  echo 'marginguard: $(PYTHON) was not found: apt install python3 python3-venv' >&2; exit 1; }
	@$(PYTHON) -I app/cli/system_checks.py
	@echo 'Making $(venv) with $(PYTHON) ...'
	@$(PYTHON) -m venv $(venv) || { rm -rf $(venv); exit 1; }

# The interfaces come with the first install: the ROS wheels that they load are installed there.
$(run): $(declared) $(interfaces) | $(python)
	@$(python) tools/install.py -e '.[ros,scene]' ./interfaces
	@touch $@

$(test): $(run)
	@$(python) tools/install.py -e '.[ros,scene,test,lint]'
	@touch $@
