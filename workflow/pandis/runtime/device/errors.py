"""Errors that OpenHaptics reports, and remedies."""

#: HDAPI's error codes, with remedies.
ERRORS = {
    0x0100: "HD_INVALID_ENUM: the library does not know a parameter; use OpenHaptics 3",
    0x0101: "HD_INVALID_VALUE: the library refuses a value; use OpenHaptics 3",
    0x0102: "HD_INVALID_OPERATION: not allowed now; stop other programs that use the device",
    0x0104: "HD_BAD_HANDLE: the device was not found; check its cable and its name",
    0x0200: "HD_WARM_MOTORS: the motors are hot; let them cool, and lower the stiffness",
    0x0201: "HD_EXCEEDED_MAX_FORCE: lower device.stiffness, or correct hardware.attached.model",
    0x0202: "HD_EXCEEDED_MAX_FORCE_IMPULSE: the force changes too fast; lower device.stiffness",
    0x0203: "HD_EXCEEDED_MAX_VELOCITY: move more slowly, or lower the stiffness",
    0x0204: "HD_FORCE_ERROR: the force could not be rendered; lower the stiffness",
    0x0300: "HD_DEVICE_FAULT: check power and cable, and calibrate the device",
    0x0302: "HD_COMM_ERROR: the connection is lost; check the cable",
    0x0304: "HD_TIMER_ERROR: the scheduler's timer fails; stop other programs",
    0x0400: "HD_ILLEGAL_BEGIN: a frame was begun within another; stop other programs",
    0x0401: "HD_ILLEGAL_END: a frame was ended before it was begun; stop other programs",
    0x0402: "HD_FRAME_ERROR: a tick had two frames; stop other programs",
}
