"""Pictures and tables of pages, from simulations."""
