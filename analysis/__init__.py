"""What people read: metrics, evaluations, commands."""
