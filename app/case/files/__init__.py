"""Files of a case and of its tools: each read strictly, and written whole or not at all."""
