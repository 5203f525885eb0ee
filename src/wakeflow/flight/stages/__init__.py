"""mesh -> airflow -> field -> tracks, each stage cached."""
