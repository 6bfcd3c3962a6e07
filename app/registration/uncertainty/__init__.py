"""How far a registration may be trusted: its result, its errors, its acceptance, its drift."""
