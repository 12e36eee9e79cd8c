"""Figures and reports: everything that draws or prints a result, and computes none."""
