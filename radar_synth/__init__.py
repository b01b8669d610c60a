"""The radar synthesiser: traffic and roadside objects in, radar scans out."""
