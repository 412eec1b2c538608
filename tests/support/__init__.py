"""Helpers of the tests: importable as ``support.NAME`` from every test file."""
