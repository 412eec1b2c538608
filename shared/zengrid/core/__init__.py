"""The market's physics and money: arrays in, arrays out; numpy only; no I/O, no clock, no globals."""
