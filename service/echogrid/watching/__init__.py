"""How the service is doing: status, metrics, journal, systemd."""
