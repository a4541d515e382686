# What a newcomer types: `make teleop`, `make test`. The rest is listed by `make help`.
SHELL := /bin/bash
BIN := .venv/bin
export PYTHON
# Hundreds of tests start a Python; without bytecode each would compile anew what it imports.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup system teleop test test-interpreted check mark-earlier test-long attack soak sweep bench bench-check bench-baseline demo docs gallery screenshots lock clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

setup:  ## make .venv from the lock and install foretouch into it
	@tools/setup

system:  ## install the system packages that tests need: browser, images, compilers of C (Debian; elsewhere set FORETOUCH_BROWSER)
	@tools/system libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0 || echo "system: the tests of camera images will be skipped" >&2
	@[ -n "$$FORETOUCH_BROWSER" ] || tools/system chromium fonts-dejavu-core || echo "system: the browser tests will be skipped" >&2
	@tools/system clang cmake g++ lld wasi-libc || echo "system: tests of the package for C and of the page of the demo that need one of these will be skipped" >&2
	@tools/system libclang-rt-dev || echo "system: the tests of the package for C with the sanitizers of clang will be skipped" >&2
	@tools/system gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user || echo "system: the tests of the package for C on an emulated aarch64 will be skipped" >&2

teleop: setup  ## the main job: leader, follower, console and recorder (options: make teleop ARGS="--headless --duration 20")
	@$(BIN)/foretouch teleop $(ARGS)

check: setup  ## lint, types, import rules; and whether every measured table says of which code it is
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python docs/measured_blocks.py

mark-earlier: setup  ## write onto the pages which of their measured tables are of earlier code
	@$(BIN)/python docs/measured_blocks.py --mark

# Laws, estimators, the contact map, rendering and steps, where their tests take seconds with nothing compiled.
INTERPRETED := $(addprefix tests/models/test_models_,$(addsuffix .py,catching_up contact_map contact_map_wire laws \
    linearisation memoryless motion predictor_catch_up leaving_work)) \
  $(addprefix tests/rendering/test_rendering_,$(addsuffix .py,energy friction limits mediation passivity_control promises \
    proxy rest share spatial_energy)) \
  $(addprefix tests/identification/test_identification_,$(addsuffix .py,classic conditioning elementary force_zero fprls \
    friction lag offline recursion)) \
  $(addprefix tests/session/test_session_,$(addsuffix .py,leader safety))
# Two are about compiled code alone: given a time that runs backwards a map overflows to infinity there, and Python
# raises; and what compiled code returns is of Python's own types.
COMPILED_ONLY := test_any_motion_of_any_map or test_a_call_of_the_map_is_the_kernel

# What runs in real time uses little more than one core; what only computes has what is left, at the lowest priority.
test: setup system  ## everything that a change must pass, in some 10 minutes on 2 cores
	@$(MAKE) --no-print-directory --jobs 2 --output-sync test-live test-beside

.PHONY: test-live test-beside test-quick
test-live: setup
	@$(BIN)/pytest -m "live and not long" $(ARGS) $$(grep -rl 'mark\.live' tests)
test-beside: setup
	@nice -n 19 $(MAKE) --no-print-directory check docs test-quick
test-quick: setup
	@$(BIN)/pytest -m "not long and not live and not soak" --numprocesses 3 --dist loadfile $(ARGS)

test-interpreted: setup  ## laws, estimators, rendering and steps with nothing compiled (NUMBA_DISABLE_JIT=1): the same answers
	@NUMBA_DISABLE_JIT=1 $(BIN)/pytest -m "not long and not live and not soak" --numprocesses 2 --dist loadfile \
	    -k "not ($(COMPILED_ONLY))" $(INTERPRETED)

test-long: setup system test-interpreted  ## what takes longer, every make target among it, and what is interpreted
	@$(BIN)/pytest -m long $(ARGS)

attack: setup  ## try to get in, to take control, and to break it with words and files, on loopback, in some minutes
	@failed=0; for script in tests/attack/attack_*.py; do $(BIN)/python $$script || failed=1; done; exit $$failed

soak: setup  ## hours: a recorder of ten hours of session at 1 kHz, and its memory; an hour of faults (FIRE_MINUTES)
	@$(BIN)/pytest -m soak -s $(ARGS)

sweep: setup  ## 1,000 simulated sessions and their page in out/sweep, in under 2 hours on 2 cores; it goes on where it was ended
	@$(BIN)/foretouch sweep --out out/sweep $(ARGS)

bench: setup  ## how fast everything is, beside peers and beside what is asked for, in some 7 minutes (ARGS="--only fprls")
	@$(BIN)/foretouch bench $(ARGS)

bench-check: setup  ## is anything slower than it was? ratios against the committed baseline, in a minute
	@$(BIN)/foretouch bench --check $(ARGS)

bench-baseline: setup  ## keep this machine's ratios as the baseline of bench-check
	@$(BIN)/foretouch bench --write-baseline src/foretouch/bench/baseline.json

demo: setup  ## write the browser page into out/demo: open out/demo/index.html
	@tools/system clang lld wasi-libc || true
	@mkdir -p out
	@$(BIN)/foretouch export page --out out/demo

docs: setup  ## build the documentation site into docs/_build, warnings as errors
	@$(BIN)/sphinx-build -q -W --keep-going -b html docs docs/_build

gallery: setup  ## draw the figures of the documentation again that take seconds each
	@for script in identifiability contact_map predictions hidden_layer rendering; do $(BIN)/python docs/draw_$$script.py; done
	@$(BIN)/python docs/measure_surfaces.py
	@$(BIN)/python docs/measure_speed.py plots

screenshots: setup system  ## take the pictures of the documentation again
	@$(BIN)/python docs/take_screenshots.py

lock:  ## resolve the dependencies again (needs uv): universal, hashed, wheels only, no index address
	@uv pip compile --universal --python-version 3.11 --fork-strategy fewest --generate-hashes --only-binary :all: \
	    --no-emit-index-url --no-header --no-annotate --all-extras --quiet --upgrade pyproject.toml -o requirements.lock

clean:  ## remove what was built; originals of recordings in the user's cache stay
	@rm -rf .venv build dist docs/_build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
