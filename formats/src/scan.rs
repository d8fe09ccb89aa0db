//! Lines, fixed columns and numbers of LMGC90's text files, with file and line attached.
