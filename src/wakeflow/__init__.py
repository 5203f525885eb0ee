"""wakeflow predicts where each fraction of granules lands behind a body in a vertical airflow."""
