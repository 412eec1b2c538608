"""The gateway: HTTP access to a running market and its journal."""
