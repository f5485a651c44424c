"""What stands along streets: houses, lots, parked cars, furniture."""
