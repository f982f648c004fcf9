# Everything lives in .venv; `make test` and `make demo` need Python and make, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.setup-done

.PHONY: setup test lint types demo bench clean

setup: $(STAMP)

# torch comes first and alone: the others would choose a build of it for themselves.
$(STAMP): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install "$$(grep '^torch==' constraints.txt)"
	$(BIN)/python -m pip install -e '.[dev,sb3,rsl-rl]' -c constraints.txt
	touch $@

test: lint types
	$(BIN)/python -m pytest -q -n 2 --dist loadfile --durations=15

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/pyright

demo: $(STAMP)
	$(BIN)/sceniris-gym demo

bench: $(STAMP)
	$(BIN)/sceniris-gym bench mid --num-envs 4096

clean:
	rm -rf $(VENV) build dist demo *.egg-info .pytest_cache .ruff_cache
