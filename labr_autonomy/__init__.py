"""LABR autonomy: two-stage land-air navigation for a wheeled quadrotor."""

__version__ = "0.1.0"
