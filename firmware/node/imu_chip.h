// SPDX-License-Identifier: Apache-2.0
// The inertial chip behind SPI: told apart by WHO_AM_I, set to 2000 deg/s and 2 g, read at its own rate.
//
// MPU-9250: gyroscope low-pass 41 Hz (5.9 ms), accelerometer 44.8 Hz, 1 kHz. ICM-20648: 51.2 Hz and 50.4 Hz, 1.125 kHz.
// Nothing is averaged and there is no dead band. Source: the chips' data sheets and register maps (InvenSense).
#pragma once

#include "node.h"
#include "port.h"

namespace sinew {

class Chip {
public:
    Chip(Node& node, Clock& clock, Spi& spi, Board& board);

    // Finds out which chip there is and sets it up; takes 0.2 s. False, and the node raises its alert, where there is none.
    bool begin();
    // Takes a sample where one is ready; an exchange of 2 bytes where none is, and of 15 more where one is.
    void poll();

private:
    enum class Kind : uint8_t { kAbsent, kMpu, kIcm };

    uint8_t read(uint8_t place);
    void write(uint8_t place, uint8_t value);
    // Resets the chip and starts its clock and sensors, by the places of three of its registers.
    void wake(uint8_t power1, uint8_t power2, uint8_t user_control);
    void set_up_mpu9250();
    void set_up_icm20648();
    void take(uint32_t now_us);

    Node& node_;
    Clock& clock_;
    Spi& spi_;
    Board& board_;
    Kind kind_ = Kind::kAbsent;
    bool works_ = false;
    uint32_t period_us_ = 0;
    uint32_t taken_us_ = 0;
    uint32_t empty_us_ = 0;  // the last look that found no sample
    bool was_fresh_ = false;
};

}  // namespace sinew
