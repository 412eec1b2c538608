"""What decides: rules, optima and trained networks, evaluated with numpy."""
