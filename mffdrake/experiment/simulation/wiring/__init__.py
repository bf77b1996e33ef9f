"""How is it wired? The parts of a scenario, and their diagram."""
