"""How are many run? Plans, the engine, its store and its tables."""
