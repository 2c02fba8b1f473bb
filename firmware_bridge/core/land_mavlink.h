// The generated dialect with what it wants to be told first.
#pragma once

#define MAVLINK_COMM_NUM_BUFFERS 1
#define MAVLINK_NO_SIGN_PACKET
#define MAVLINK_NO_SIGNATURE_CHECK
#define MAVLINK_NO_CONVERSION_HELPERS
#define MAVLINK_NO_SHA256

#include "labr_land/mavlink.h"
