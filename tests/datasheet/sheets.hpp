// Data sheets of motors, their values as the source gives them (prefixes of units carried out). The
// convention of a value is the one that the source states; where it states none, `source` says so.
#pragma once
#include <string>
#include <vector>

namespace twinrate::test {

struct KnownSheet {
  std::string preset, motor, source;
  std::vector<std::string> pairs;  // of `twinrate machine new --from`
};

inline const std::vector<KnownSheet>& known_sheets() {
  static const std::string premo =
      "premo manual 4022-D045530 rev. 02, Tbl-16, "
      "manualshive.com/en/manual/wittenstein-alpha/premo-sp-series/990162?page=30";
  static const std::string ec45 =
      "maxon catalogue, online.flippingbook.com/view/1042987/324; 16 poles: "
      "github.com/matthieuvigne/nemo_bldc, motor_library.json";
  static const std::string mathworks =
      "mcb_SetPMSMMotorParameters.m, The MathWorks 2020 (Motor Control Blockset)";
  static const std::string psi = "github.com/paulscherrerinstitute/ecmccfg, hardware/Motors/";
  static const std::vector<KnownSheet> list = {
      {"wittenstein_premo_1c",
       "WITTENSTEIN premo, stator 1C, 320 V",
       premo,
       {"n_p=4", "ke_V_krpm=21.0", "ke_convention=line_rms", "kt_Nm_A=0.35", "kt_convention=rms",
        "r_ll_Ohm=15.1", "l_ll_H=10.4e-3", "inertia_kgcm2=0.22", "rated_current_A_rms=1.73",
        "rated_torque_Nm=0.60", "v_dc_V=320"}},
      {"wittenstein_premo_2c",
       "WITTENSTEIN premo, stator 2C, 320 V",
       premo,
       {"n_p=4", "ke_V_krpm=23.7", "ke_convention=line_rms", "kt_Nm_A=0.39", "kt_convention=rms",
        "r_ll_Ohm=5.70", "l_ll_H=6.12e-3", "inertia_kgcm2=0.35", "rated_current_A_rms=2.96",
        "rated_torque_Nm=1.17", "v_dc_V=320"}},
      {"wittenstein_premo_1d",
       "WITTENSTEIN premo, stator 1D, 320 V",
       premo,
       {"n_p=4", "ke_V_krpm=25.0", "ke_convention=line_rms", "kt_Nm_A=0.41", "kt_convention=rms",
        "r_ll_Ohm=7.48", "l_ll_H=10.2e-3", "inertia_kgcm2=0.46", "rated_current_A_rms=2.74",
        "rated_torque_Nm=1.09", "v_dc_V=320"}},
      {"wittenstein_premo_2d",
       "WITTENSTEIN premo, stator 2D, 320 V",
       premo,
       {"n_p=4", "ke_V_krpm=31.6", "ke_convention=line_rms", "kt_Nm_A=0.52", "kt_convention=rms",
        "r_ll_Ohm=3.72", "l_ll_H=7.43e-3", "inertia_kgcm2=0.83", "rated_current_A_rms=4.04",
        "rated_torque_Nm=2.11", "v_dc_V=320"}},
      {"wittenstein_premo_1f",
       "WITTENSTEIN premo, stator 1F, 320 V",
       premo,
       {"n_p=4", "ke_V_krpm=31.1", "ke_convention=line_rms", "kt_Nm_A=0.51", "kt_convention=rms",
        "r_ll_Ohm=3.23", "l_ll_H=6.97e-3", "inertia_kgcm2=1.57", "rated_current_A_rms=4.80",
        "rated_torque_Nm=2.46", "v_dc_V=320"}},
      {"wittenstein_premo_3f",
       "WITTENSTEIN premo, stator 3F, 320 V",
       premo,
       {"n_p=4", "ke_V_krpm=32.5", "ke_convention=line_rms", "kt_Nm_A=0.54", "kt_convention=rms",
        "r_ll_Ohm=0.53", "l_ll_H=2.25e-3", "inertia_kgcm2=4.13", "rated_current_A_rms=12.2",
        "rated_torque_Nm=6.38", "v_dc_V=320"}},
      {"siemens_1ft7044",
       "Siemens 1FT7044-AK7, 600 V",
       "Siemens (PFT7S) 01/2009, 6SN1197-0AD13-0BP2, table 4-8, "
       "easymanua.ls/siemens/1ft7/manual/704590?p=90; k_E line to line rms: p. 404 of the 2018 "
       "edition; 600 V is that of the inverter family",
       {"poles=6", "ke_V_krpm=57", "ke_convention=line_rms", "kt_Nm_A=0.88", "kt_convention=rms",
        "r_phase_Ohm=0.61", "l_phase_H=4.2e-3", "inertia_kgcm2=5.43", "rated_current_A_rms=2.5",
        "rated_torque_Nm=2", "rated_speed_rpm=6000", "mechanical_time_constant_ms=1.3",
        "v_dc_V=600"}},
      {"maxon_ec45_24v",
       "maxon EC 45 flat, 70 W, 24 V winding",
       ec45,
       {"poles=16", "kv_rpm_V=236", "kv_convention=line_peak", "kt_Nm_A=0.0404",
        "kt_convention=block", "r_ll_Ohm=0.573", "l_ll_H=0.301e-3", "inertia_gcm2=181",
        "rated_current_A_block=3.29", "rated_torque_Nm=0.134", "rated_speed_rpm=4750",
        "mechanical_time_constant_ms=6.35", "v_dc_V=24"}},
      {"maxon_ec45_36v",
       "maxon EC 45 flat, 70 W, 36 V winding",
       ec45,
       {"poles=16", "kv_rpm_V=167", "kv_convention=line_peak", "kt_Nm_A=0.057",
        "kt_convention=block", "r_ll_Ohm=1.560", "l_ll_H=0.601e-3", "inertia_gcm2=181",
        "rated_current_A_block=1.97", "rated_torque_Nm=0.110", "rated_speed_rpm=5080",
        "mechanical_time_constant_ms=8.68", "v_dc_V=36"}},
      {"maxon_ec45_48v",
       "maxon EC 45 flat, 70 W, 48 V winding",
       ec45,
       {"poles=16", "kv_rpm_V=118", "kv_convention=line_peak", "kt_Nm_A=0.0808",
        "kt_convention=block", "r_ll_Ohm=3.070", "l_ll_H=1.210e-3", "inertia_gcm2=181",
        "rated_current_A_block=1.41", "rated_torque_Nm=0.112", "rated_speed_rpm=4750",
        "mechanical_time_constant_ms=8.51", "v_dc_V=48"}},
      {"maxon_ec45_60v",
       "maxon EC 45 flat, 70 W, 60 V winding",
       ec45,
       {"poles=16", "kv_rpm_V=62.8", "kv_convention=line_peak", "kt_Nm_A=0.152",
        "kt_convention=block", "r_ll_Ohm=7.370", "l_ll_H=4.270e-3", "inertia_gcm2=181",
        "rated_current_A_block=0.92", "rated_torque_Nm=0.143", "rated_speed_rpm=3010",
        "mechanical_time_constant_ms=5.77", "v_dc_V=60"}},
      {"maxon_ecmax40",
       "maxon EC-max 40, 120 W, 283870, encoder MR 1000",
       psi + "ecmcEL7411-Motor-Maxon-283870.cmd and ..-M283870-E228456.cmd",
       {"n_p=1", "kv_rpm_V=231", "kv_convention=line_peak", "kt_Nm_A=0.0448", "kt_convention=block",
        "r_ll_Ohm=1.03", "l_ll_H=0.204e-3", "inertia_gcm2=101", "rated_current_A_block=4.06",
        "rated_torque_Nm=0.170", "rated_speed_rpm=9250", "mechanical_time_constant_ms=5.17",
        "v_dc_V=48", "encoder_counts=4000"}},
      {"anaheim_bly171d",
       "Anaheim Automation BLY171D-24V-4000, encoder of 1250 lines",
       "mathworks.com/help/mcb/ref/mcb.getpmsmparameters.html; K_e line to line peak: comment of "
       "mcb_SetPMSMMotorParameters",
       {"n_p=4", "ke_V_krpm=3.8", "ke_convention=line_peak", "kt_Nm_A=0.034", "kt_convention=peak",
        "r_phase_Ohm=0.75", "l_phase_H=1.05e-3", "inertia_kgm2=2.4019e-6",
        "rated_current_A_peak=1.8", "rated_torque_Nm=0.0566", "v_dc_V=24", "encoder_counts=5000"}},
      // K_t of the next three is left out: what the files print fits no convention of their K_e.
      {"anaheim_bly172s",
       "Anaheim Automation BLY172S-24V-4000, encoder of 1250 lines",
       mathworks,
       {"n_p=4", "ke_V_krpm=4", "ke_convention=line_peak", "r_phase_Ohm=0.4", "l_phase_H=0.6e-3",
        "inertia_kgm2=4.8019e-6", "rated_current_A_peak=3.5", "v_dc_V=24", "encoder_counts=5000"}},
      {"teknic_2310p",
       "Teknic M-2310P, encoder of 1000 lines",
       mathworks,
       {"n_p=4", "ke_V_krpm=4.64", "ke_convention=line_peak", "r_phase_Ohm=0.36",
        "l_phase_H=0.2e-3", "inertia_kgm2=7.0616e-6", "rated_current_A_peak=7.1", "v_dc_V=24",
        "encoder_counts=4000"}},
      {"hurst_dmb0224c10002",
       "Hurst DMB0224C10002 (Hurst075), 24 V",
       "parameters of mchp_pmsm_foc_ips_dsPIC33_data.m, Microchip Technology 2025",
       {"n_p=5", "ke_V_krpm=7.5678", "ke_convention=line_peak", "r_phase_Ohm=2.8322",
        "l_d_H=2.42345e-3", "l_q_H=2.3278e-3", "inertia_kgm2=5.5e-6", "rated_current_A_rms=1.16",
        "v_dc_V=24"}},
      {"beckhoff_am8122",
       "Beckhoff AM8122-0FH1-0000, 48 V",
       psi + "ecmcEP7211-0034-Motor-Beckhoff-AM8122-0FH1-0000.cmd (electronic nameplate); values "
             "between terminals: infosys.beckhoff.com, AX8000 objects 32C0:06, 32C0:07",
       {"n_p=3", "ke_V_krpm=13", "ke_convention=line_rms", "kt_Nm_A=0.200", "kt_convention=rms",
        "r_ll_Ohm=1.5", "l_ll_H=3.3e-3", "inertia_gcm2=330", "rated_current_A_rms=4.65",
        "v_dc_V=48"}},
      {"beckhoff_am8113",
       "Beckhoff AM8113-0F21-0000, 48 V",
       psi + "ecmcEL7211-0010-Motor-Beckhoff-AM8122-0FH1-0000.cmd (its electronic nameplate is of "
             "this motor)",
       {"n_p=3", "ke_V_krpm=7", "ke_convention=line_rms", "kt_Nm_A=0.108", "kt_convention=rms",
        "r_ll_Ohm=1.45", "l_ll_H=0.9e-3", "inertia_gcm2=94", "rated_current_A_rms=4.65",
        "v_dc_V=48"}},
      {"hbl48zl400330k",
       "servo motor HBL48ZL400330K, 48 V, encoder of 2500 lines",
       "github.com/sjw1109/gmp_pro, ctl/component/motor_control/preset_motor_param/"
       "HBL48ZL400330K.h; conventions of K_e and of the current are not stated",
       {"n_p=8", "ke_V_krpm=10.5", "ke_convention=line_peak", "r_ll_Ohm=0.4", "l_ll_H=0.6e-3",
        "inertia_kgcm2=0.45", "rated_current_A_rms=11", "rated_torque_Nm=1.27",
        "rated_speed_rpm=3000", "v_dc_V=48", "encoder_counts=10000"}},
      {"lst_127",
       "servo motor LST-127-2-30-560, 235 V",
       "Niewiara, Tarczewski, Grzesiak 2020, table 1 (config/niewiara2020.toml)",
       {"n_p=3", "kt_Nm_A=1.14", "kt_convention=peak", "r_phase_Ohm=1.05", "l_phase_H=12.7e-3",
        "inertia_kgm2=8.8e-3", "rated_current_A_rms=5.0", "rated_torque_Nm=8.1",
        "rated_speed_rpm=1000", "v_dc_V=235.4", "encoder_counts=1048576"}},
  };
  return list;
}

}  // namespace twinrate::test
