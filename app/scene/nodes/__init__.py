"""Nodes of MRML, whatever they show: values to nodes and back, many changes as one."""
