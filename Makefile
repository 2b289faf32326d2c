# Two commands for a new user: `make demo` and `make test`. Each does all its own set-up in .venv.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test test-extras lint docs clean

# The base installation; remade when the dependencies change. Byte code is made where something is imported: making that of all
# packages is two fifths of an installation.
.venv/base: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("EVIS needs Python 3.11 or newer, this is " + sys.version.split()[0] + \
	  ": make PYTHON=/path/to/python3.11 ...") if sys.version_info < (3, 11) else 0'
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "installing into .venv (about a minute the first time)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e .
	@touch $@

# What the tests need besides.
.venv/dev: .venv/base
	@echo "installing the test tools into .venv"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[dev]'
	@touch $@

# A spinning disk: bag, animation, picture and summary in demo/. With VIEW=1 the live page stays open until Ctrl-C.
demo: .venv/base
	@$(BIN)/python -m evis.demo --out demo

# Rooms and files whose tests compute, or run graphs that nobody times, the longest first: JOBS of them at once. Those that wait for
# processes, pages and devices more than they compute: JOBS of these at once. All others look at clocks and come alone.
JOBS ?= 2
COMPUTE := $(addprefix tests/,simulation dataset launch/graph shares bench rate_divider \
  cli/test_extreme_graphs.py cli/test_auto_choice.py runtime/test_device_arrays.py \
  gpu/test_precompiled_headers.py python audit env \
  event_sensor events frame_camera geometry house imu interpolator labeler measure media msgs physics renderer resets scene web)
WAIT := $(addprefix tests/,visualizer foxglove client camera bag cli gpu/test_parallel_kernel_builds.py \
  runtime/test_shadowed_modules.py config launch/files launch/supervisor/test_early_start.py launch/supervisor/test_secrets.py)

# Tests start hundreds of processes: what one has compiled of our sources is there for the next, whatever the shell says.
test: export PYTHONDONTWRITEBYTECODE =

test: .venv/dev lint
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile $(COMPUTE)
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile $(WAIT) $(addprefix --ignore=,$(COMPUTE))
	@$(BIN)/python -m pytest -q $(addprefix --ignore=,$(COMPUTE) $(WAIT))

# What needs PyTorch, Stable-Baselines3, Ray or tonic: gigabytes, so in an environment of its own. TORCH chooses the build:
# `make test-extras TORCH='torch==2.13.0+cpu'` where pip knows of one without CUDA.
TORCH ?= torch>=2.4,<3
EXTRAS := .venv-extras/bin

.venv-extras/ready: pyproject.toml
	@test -x $(EXTRAS)/python || $(PYTHON) -m venv .venv-extras
	@echo "installing PyTorch and what is tested with it into .venv-extras"
	@$(EXTRAS)/python -m pip install --quiet --disable-pip-version-check '$(TORCH)'
	@$(EXTRAS)/python -m pip install --quiet --disable-pip-version-check -e '.[test-extras]'
	@touch $@

test-extras: .venv-extras/ready
	@$(EXTRAS)/python -m pytest -q -m 'extras and not gpu'

lint: .venv/dev
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --diff --quiet .
	@$(BIN)/mypy --no-error-summary

# Pictures and tables of docs/ that code makes. Figures are measured anew by `evis bench ... --docs docs/performance.md`.
docs: .venv/base
	@$(BIN)/python docs/rooms.py
	@$(BIN)/python docs/frame_camera.py
	@$(BIN)/python -m bench.documents
	@$(BIN)/python -m evis.demo.gallery --out docs/scenes
	@$(BIN)/python -m evis.demo.sheets --out docs/recipes

clean:
	rm -rf .venv .venv-extras demo report build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
