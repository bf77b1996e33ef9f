PYTHON ?= python3
.PHONY: demo quick-demo test lint lab bench
demo quick-demo test lint lab bench: ; @$(PYTHON) tools/dev.py $@ -- $(ARGS)
