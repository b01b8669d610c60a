"""The camera synthesiser: road and traffic in, 320x240 grey frames out."""
