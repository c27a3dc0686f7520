"""What searches by Optuna share: the package, and the journal from which one goes on."""
