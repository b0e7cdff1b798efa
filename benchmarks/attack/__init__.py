"""An attack on the readers: mangled campaigns, machines and scenarios, seeded, each in a process that may die."""
