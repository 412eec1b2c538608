"""Validated scenario files, their profiles and day generator, and readers for measured data."""
