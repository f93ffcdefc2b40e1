"""Reference results that an FMU carries (FMI-LS-REF): what is declared, and what comes out when it is run again."""
