"""The emulated devices on the line: their control table, a motor with its servo loops, the sensor on the head."""
