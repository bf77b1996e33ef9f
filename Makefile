PYTHON ?= python3
.PHONY: demo test lint lab
demo test lint lab: ; @$(PYTHON) tools/dev.py $@ -- $(ARGS)
