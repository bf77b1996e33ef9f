"""How is a pose searched? The 1-step GA, Eq. (23)-(28)."""
