"""The commands that calibrate and decode: files in, rig, figures and a page out."""
