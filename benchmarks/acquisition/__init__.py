"""How soon and how surely targets of all shapes are found."""
