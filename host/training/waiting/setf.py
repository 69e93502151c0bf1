import sys,json,struct,zlib
from safetensors.numpy import load,save
src,dst,fr=sys.argv[1:4]
b=open(src,'rb').read(); n=struct.unpack('<Q',b[:8])[0]; meta=dict(json.loads(b[8:8+n])['__metadata__']); meta.pop('crc32'); meta['friction']=fr
T=load(b); d=save(T,meta); n=struct.unpack('<Q',d[:8])[0]; data=d[8+n:]; c=0
for k in sorted(meta): c=zlib.crc32(f'{k}={meta[k]}\n'.encode(),c)
meta['crc32']=f'{zlib.crc32(data,c):08x}'; open(dst,'wb').write(save(T,meta))
