"""Best schedules with certificates, what a controller makes of them, and programs for them."""
