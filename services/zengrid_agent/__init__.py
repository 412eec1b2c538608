"""Agents: the grid agent sets the buy price, prosumer agents command batteries; each is a process of its own."""
