"""The emulated bench: the same bytes from the other side, with the twin behind them."""
