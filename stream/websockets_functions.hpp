// The functions of libwebsockets that a server calls: the part `websockets` (core/load_part.hpp).
#pragma once
#include <libwebsockets.h>

namespace twinrate {

struct WebsocketsFunctions {
  decltype(&lws_create_context) create_context;
  decltype(&lws_context_destroy) destroy_context;
  decltype(&lws_context_user) context_user;
  decltype(&lws_get_context) context_of;
  decltype(&lws_get_vhost_by_name) vhost;
  decltype(&lws_get_vhost_listen_port) listen_port;
  decltype(&lws_service) serve;
  decltype(&lws_callback_on_writable) call_when_writable;
  decltype(&lws_send_pipe_choked) is_choked;
  decltype(&lws_write) write;
  decltype(&lws_is_final_fragment) is_final_fragment;
  decltype(&lws_remaining_packet_payload) bytes_to_come;
  decltype(&lws_set_log_level) log_level;
};

}  // namespace twinrate
