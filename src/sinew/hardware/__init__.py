"""What speaks to motors and sensors: packets, registers, the port and the bus."""
