"""From raw signals to features: sound."""
