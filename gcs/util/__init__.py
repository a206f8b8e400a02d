"""Reading what others wrote: bounded files, JSON and archives."""
