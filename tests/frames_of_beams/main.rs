//! Frames of beams in space: the elements obey statics and closed forms, bad files are refused with what to mend, and
//! every bridge that ships has the modes that are written here.

mod shipped;
