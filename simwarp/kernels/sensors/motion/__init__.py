"""Motion and forces as sensors feel them: inertial, satellite, encoders."""
