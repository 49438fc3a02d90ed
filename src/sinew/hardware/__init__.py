"""This is where motors and sensors are spoken to: packets, registers, the port and the bus."""
