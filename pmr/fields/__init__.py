"""Fields over a body's points and cells, and stresses as rows; no finite-element library behind them."""
