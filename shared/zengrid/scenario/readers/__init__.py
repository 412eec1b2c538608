"""Readers for measured data: plain CSV, CityLearn building files, CAISO OASIS exports."""
