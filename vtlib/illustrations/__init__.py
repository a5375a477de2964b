"""Formulas that move: small exact computations behind the sliders of the theory pages."""
