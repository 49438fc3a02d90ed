"""This is where the bench is played: the same bytes from the other side, with the twin behind them."""
