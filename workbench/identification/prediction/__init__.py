"""Prediction-error identification: models refined until their one-step prediction is the best."""
