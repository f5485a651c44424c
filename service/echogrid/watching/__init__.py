"""How the service fares: status, metrics, journal, systemd."""
