PYTHON ?= python3
.PHONY: help demo quick-demo test test-all lint bench docs lab
help demo quick-demo test test-all lint bench docs lab: ; @$(PYTHON) tools/dev.py $@ -- $(ARGS)
