"""The clock: owns time, the environment, settlement and the journal; the hub of a market."""
