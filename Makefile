# Everything lives in .venv; `make test` and `make demo` need Python and make, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.setup-done
OLDEST := .venv-oldest
OLDEST_STAMP := $(OLDEST)/.setup-done
RECIPES := skrl torchrl
MJLAB := .venv-mjlab
JAX := .venv-jax
NEWTON := .venv-newton
LEROBOT := .venv-lerobot

# What the first import compiles is kept for all others.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup test check test-changed test-suite test-marked-oldest test-oldest lint types docs test-recipes test-mjlab test-jax test-newton test-lerobot demo bench clean

setup: $(STAMP)

# Two processes install half of the exact versions each, as pip uses one core. Then pip installs the package, and whatever
# it misses. Modules are compiled when they are first imported, which is a quarter of them.
$(STAMP): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	sed '/^$$/,$$d; /^#/d' constraints.txt | xargs -P 2 -n 67 $(BIN)/python -m pip install --no-deps --no-compile --no-warn-conflicts
	$(BIN)/python -m pip install --no-compile --no-build-isolation -e '.[dev]' -c constraints.txt
	touch $@

# The oldest versions that are supported, over everything else that .venv has.
$(OLDEST_STAMP): constraints-oldest.txt $(STAMP)
	rm -rf $(OLDEST)
	$(BIN)/python -m venv --without-pip $(OLDEST)
	$(BIN)/python -m pip --python $(OLDEST)/bin/python install --no-deps -r constraints-oldest.txt
	site() { "$$1" -c "import sysconfig; print(sysconfig.get_path('purelib'))"; }; \
	echo "import site; site.addsitedir('$$(site $(BIN)/python)')" > "$$(site $(OLDEST)/bin/python)/rest.pth"
	touch $@

# Lint and types take seconds, and the oldest versions wait for their installation: the suite runs beside what is left.
test: $(STAMP)
	+$(MAKE) --no-print-directory -j 2 lint types test-marked-oldest test-suite

test-suite: $(STAMP)
	$(BIN)/python -m pytest -q -n 2 --dist loadfile --durations=15

# Lint, types and the tests that import what changed since origin/main, side by side.
check: $(STAMP)
	+$(MAKE) --no-print-directory -j 3 --output-sync=target lint types test-changed

test-changed: $(STAMP)
	$(BIN)/python -m pytest -q -m "not slow" $$($(BIN)/python -m tests.changed)

test-marked-oldest: $(OLDEST_STAMP)
	$(OLDEST)/bin/python -m pytest -q -m oldest $$(grep -rl 'mark\.oldest' tests)

test-oldest: $(OLDEST_STAMP)
	$(OLDEST)/bin/python -m pytest -q -n 2 --dist loadfile --durations=15

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/pyrefly check

# The site, into site/: every warning is an error, so dead links and anchors are.
docs: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

# Libraries whose needs differ from those of the development environment, each in one of its own.
test-recipes: $(addprefix test-recipe-,$(RECIPES))

test-recipe-%:
	test -x $(VENV)-$*/bin/python || $(PYTHON) -m venv $(VENV)-$*
	$(VENV)-$*/bin/python -m pip install "$$(grep '^torch==' constraints.txt)"
	$(VENV)-$*/bin/python -m pip install -e . $* pytest ruamel.yaml python-fcl "$$(grep '^torch==' constraints.txt)"
	$(VENV)-$*/bin/python -m pytest -q tests/test_recipes.py tests/adapters/test_wrappers.py -k $*

# mjlab needs MuJoCo 3.11.
test-mjlab:
	test -x $(MJLAB)/bin/python || $(PYTHON) -m venv $(MJLAB)
	$(MJLAB)/bin/python -m pip install "$$(grep '^torch==' constraints.txt)"
	$(MJLAB)/bin/python -m pip install -e '.[mjlab]' pytest "$$(grep '^torch==' constraints.txt)"
	$(MJLAB)/bin/python -m pytest -q --durations=5 tests/adapters/mjlab

# MJX and Newton need MuJoCo 3.17, whose differences the tests for the oldest versions would find.
test-jax:
	test -x $(JAX)/bin/python || $(PYTHON) -m venv $(JAX)
	$(JAX)/bin/python -m pip install "$$(grep '^torch==' constraints.txt)"
	$(JAX)/bin/python -m pip install -e '.[jax]' pytest "$$(grep '^torch==' constraints.txt)"
	$(JAX)/bin/python -m pytest -q --durations=5 tests/adapters/test_jax.py

test-newton:
	test -x $(NEWTON)/bin/python || $(PYTHON) -m venv $(NEWTON)
	$(NEWTON)/bin/python -m pip install "$$(grep '^torch==' constraints.txt)"
	$(NEWTON)/bin/python -m pip install -e '.[newton]' pytest "$$(grep '^torch==' constraints.txt)"
	$(NEWTON)/bin/python -m pytest -q --durations=5 -m oldest $$(grep -rl 'mark\.oldest' tests)
	$(NEWTON)/bin/python -m pytest -q --durations=5 tests/adapters/test_newton.py

# LeRobot needs an older torch. It takes demonstrations from files, and nothing else of this package.
test-lerobot:
	test -x $(LEROBOT)/bin/python || $(PYTHON) -m venv $(LEROBOT)
	$(LEROBOT)/bin/python -m pip install "$$(sed -n 's/^lerobot = \["\(.*\)"\]/\1/p' pyproject.toml)" lazy-loader pytest
	$(LEROBOT)/bin/python -m pip install --no-deps -e .
	$(LEROBOT)/bin/python -m pytest -q --noconftest tests/dataset/test_lerobot.py

demo: $(STAMP)
	$(BIN)/sceniris-gym demo

bench: $(STAMP)
	$(BIN)/sceniris-gym bench mid --num-envs 4096

clean:
	rm -rf $(VENV) $(OLDEST) $(addprefix $(VENV)-,$(RECIPES)) $(MJLAB) $(JAX) $(NEWTON) $(LEROBOT) build dist demo site *.egg-info .pytest_cache .ruff_cache
