# MarginGuard: `make demo` and `make test` work in a fresh clone.

PYTHON ?= python3

venv    := .venv
python  := $(venv)/bin/python
run     := $(venv)/.installed-run
test    := $(venv)/.installed-test
site    := $(venv)/.installed-docs
foxglove := tests/foxglove/node_modules/.package-lock.json

case    := data/recorded_case
report  := out/demo

# Files that determine what is installed. The Python files of the project are used in place (-e).
declared   := pyproject.toml constraints.txt tools/install.py
interfaces := $(shell find interfaces interfaces_extra -type f -not -path '*/build/*' -not -path '*.egg-info/*' \
                -not -path '*/__pycache__/*')

# If the start-up hook of the ROS wheels of another environment set it, the hook of this one would not run.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Else each of the many processes of the tests would compile the sources again.
unexport PYTHONDONTWRITEBYTECODE

.DELETE_ON_ERROR:
.PHONY: help environment demo test test-fast test-long test-documents test-pages test-exhaustive test-wheel test-foxglove docs lint format doctor clean bench-faults

help:
	@echo 'make demo       install, then replay $(case) into $(report)'
	@echo 'make test       install the test dependencies, then run the suite'
	@echo 'make test-fast  run the quick tests only: no ROS graph, no rendering, no browser'
	@echo 'make test-long  run the long tests on an idle machine: cohorts, real time, notebooks, browser runs'
	@echo 'make test-documents, make test-pages  those of them that CI runs'
	@echo 'make test-exhaustive  repeat in full what shorter tests of the suite show (hours, idle machine)'
	@echo 'make bench-faults  inject the whole matrix of faults into a live session (15 minutes)'
	@echo 'make test-wheel build the wheels, install them in a new environment, run the commands there'
	@echo 'make test-foxglove  read the results of a replay with packages of Foxglove (npm)'
	@echo 'make docs       build the documentation site into out/docs, and check its links and pages'
	@echo 'make lint       ruff and mypy'
	@echo 'make format     let ruff rewrite the files'
	@echo 'make doctor     check the installation'
	@echo 'make clean      remove the environment and all generated files'
	@echo 'PYTHON=...      the Python of the environment (3.11 to 3.13; now $(PYTHON))'

demo: $(run)
	@$(venv)/bin/marginguard replay $(case) --report $(report)
	@echo 'The report is $(report)/report.html'

# The times of all tests are kept for `python -m tools.durations`.
pytest = $(python) -m pytest --workers $(2) --tier $(1) --junitxml out/tests/$(1).xml

test: $(test)
	@$(call pytest,suite,4) $(PYTEST_ARGS)

# Each test file names its tier: tests/tiers.py.
test-fast: $(test)
	@$(call pytest,fast,2) $(PYTEST_ARGS)

# Two workers: most of these tests run live sessions, which miss their deadlines on a busy machine.
test-long: $(test)
	@$(call pytest,long,2) $(PYTEST_ARGS)

# Those of them that CI runs: start pages, reports, shipped cases, analysis, simulation, holds, one at a time on a busy machine ...
test-documents: $(test)
	@$(python) -m pytest --tier long --junitxml out/tests/documents.xml tests/docs tests/report tests/hold tests/igtl \
	  $(addprefix tests/analysis/test_, specimen.py depth.py breach_probability.py) \
	  $(addprefix tests/simulation/test_, commands.py dynamics.py guided_push.py kinematics.py loops.py shipped_world.py) \
	  $(addprefix tests/session/, plausibility test_long_repetition.py) tests/runtime tests/cohort/test_case_run.py \
	  $(addprefix tests/cli/, calibration test_gc_control.py test_whole_cases.py)

# ... and pages, examples, pushes, and changes of structures in a live session.
test-pages: $(test)
	@$(call pytest,long,2) tests/examples tests/viewer tests/bridge/faults/test_live_structures.py \
	  tests/fixture/control/test_push.py

test-exhaustive: $(test)
	@$(python) -m pytest --tier exhaustive $(PYTEST_ARGS)

# Minutes of processor time: two builds, 2 GB of packages. It uses the kernels and the messages that `make test` has compiled.
test-wheel: $(test)
	@$(python) -m pytest tests/tools/built_wheel.py tests/tools/installed_wheel.py $(PYTEST_ARGS)

# No part of test-long: it needs Node.js and 11 packages of npm (5 MB), which no other test needs.
test-foxglove: $(test) $(foxglove)
	@$(python) -m pytest tests/foxglove/bag_in_foxglove_readers.py $(PYTEST_ARGS)

# The lock file pins versions and hashes.
$(foxglove): tests/foxglove/package-lock.json
	@command -v npm > /dev/null || { \
	  echo 'marginguard: npm was not found: install Node.js 20 with npm' >&2; exit 1; }
	@npm ci --prefix tests/foxglove --ignore-scripts --no-audit --no-fund
	@touch $@

# Warnings are errors. Notebooks are executed; nothing is fetched from other hosts.
docs: $(site)
	@rm -rf out/docs
	@$(python) -m sphinx -W --keep-going -q -c docs -d out/doctrees . out/docs
	@$(python) -m tools.check_site out/docs

# Exit status 1 if a controller is permitted to approach during a fault that can be detected.
bench-faults: $(test)
	@$(venv)/bin/marginguard bench faults $(BENCH_ARGS)

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
	@rm -rf $(venv) tests/foxglove/node_modules out build interfaces/build interfaces_extra/build .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -prune -exec rm -rf {} + -o -name '*.egg-info' -prune -exec rm -rf {} +

$(python):
	@command -v $(PYTHON) > /dev/null || { \
	  echo 'marginguard: $(PYTHON) was not found: apt install python3 python3-venv' >&2; exit 1; }
	@$(PYTHON) -I app/cli/system_checks.py
	@echo 'Making $(venv) with $(PYTHON) ...'
	@$(PYTHON) -m venv $(venv) || { rm -rf $(venv); exit 1; }

# Everything that .ci/run needs, before it runs parts side by side.
environment: $(site)

# The interfaces are installed together with the ROS wheels, which they load.
$(run): $(declared) $(interfaces) | $(python)
	@$(python) tools/install.py -e '.[ros,scene,simulation,notebook,hdf5,cohort,dicom,volume,video,planning]' ./interfaces
	@touch $@

$(test): $(run)
	@$(python) tools/install.py -e '.[ros,scene,simulation,test,lint]' ./interfaces_extra
	@touch $@

$(site): $(test)
	@$(python) tools/install.py -e '.[ros,scene,test,lint,docs]'
	@touch $@
