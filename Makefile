PYTHON ?= python3
.PHONY: help demo quick-demo test test-all fuzz lint bench docs lab
help demo quick-demo test test-all fuzz lint bench docs lab: ; @$(PYTHON) tools/dev.py $@ -- $(ARGS)
