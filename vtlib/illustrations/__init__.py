"""Small computations behind the moving formulas of the text."""
