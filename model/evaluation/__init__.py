"""What a trained model is judged by: baselines, metrics, splits, forecast errors, the style classifier.

May import every other room of ``model``; none of them imports it.
"""
