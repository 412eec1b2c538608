"""The clock: owns the environment, time, settlement and the journal; the hub every agent connects to."""
