"""Manoeuvres assessed: what standards measure of a run, rules that it keeps or not, and batches of speeds."""
