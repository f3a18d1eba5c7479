"""``python -m lvnav_trade`` is ``lvnav-trade``."""

from lvnav_trade.cli import main

main()
