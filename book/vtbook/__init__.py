"""What the book's pages are made of: its experiments, claims, figures, tables and panels.

``vtlib`` is the method and what runs experiments; it knows nothing of these.
"""
