PYTHON ?= python3
.PHONY: help demo quick-demo test lint bench lab
help demo quick-demo test lint bench lab: ; @$(PYTHON) tools/dev.py $@ -- $(ARGS)
