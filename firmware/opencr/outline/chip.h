// SPDX-License-Identifier: Apache-2.0
// The core has a header of this name, which a sketch's own must not hide.
#pragma once

#define BDPIN_SPI_CS_IMU 28
#define BDPIN_DXL_PWR_EN 32
