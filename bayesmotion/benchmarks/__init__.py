"""What computations cost, measured."""
