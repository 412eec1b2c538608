"""The gateway: a market over HTTP, live and from its history, and a page that shows it."""
