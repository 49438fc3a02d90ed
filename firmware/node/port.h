// SPDX-License-Identifier: Apache-2.0
// What the node asks of a board: a clock, a wire, a memory that outlives a loss of power, a chip, a way to start anew.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sinew {

class Clock {
public:
    // Microseconds; wraps after 71.6 minutes.
    virtual uint32_t micros() = 0;

protected:
    ~Clock() = default;
};

// One line to a master, which other devices may share.
class Wire {
public:
    // The next byte that has come, -1 where there is none.
    virtual int read() = 0;
    // Sends bytes without a pause; returns when the line is free again for others.
    virtual void write(const uint8_t* bytes, size_t size) = 0;
    virtual void set_baud(uint32_t baud) = 0;

protected:
    ~Wire() = default;
};

// A few bytes that outlive a loss of power.
class Store {
public:
    // False where nothing whole was stored.
    virtual bool load(uint8_t* bytes, size_t size) = 0;
    virtual void save(const uint8_t* bytes, size_t size) = 0;

protected:
    ~Store() = default;
};

// The chip's SPI: chip select around one exchange.
class Spi {
public:
    virtual void exchange(uint8_t* bytes, size_t size) = 0;

protected:
    ~Spi() = default;
};

class Board {
public:
    // Starts anew, as after power-on; may return, the node then begins anew by itself.
    virtual void restart() = 0;
    virtual void wait_ms(uint32_t milliseconds) = 0;

protected:
    ~Board() = default;
};

}  // namespace sinew
