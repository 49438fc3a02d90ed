"""What can be asked of equations of motion: where they rest, how they move on, how they swing steadily."""
