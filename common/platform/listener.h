#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <string>

namespace twoport {

/// Listens at ADDR:PORT, the value of `flag`; port 0: any free one. Throws ConfigError with the address and what to do.
boost::asio::ip::tcp::acceptor listen_at(boost::asio::io_context& context, const std::string& address,
                                         const char* flag);

/// "127.0.0.1:8765" as others reach it: under a wildcard address, by this machine's route to the rest of the network.
std::string reached_at(const boost::asio::ip::tcp::acceptor& acceptor);

}  // namespace twoport
