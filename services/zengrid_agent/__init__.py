"""The agents: a grid and any number of prosumers, each a process that answers observations."""
